"""Viewers that need a screen, a browser or an off-screen renderer; only `cli` imports them."""
