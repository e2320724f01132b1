"""The interactive editor: a session without a screen, its preview, and a page around them."""
