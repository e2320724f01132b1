"""Viewers that need a screen or an off-screen renderer; nothing else imports them."""
