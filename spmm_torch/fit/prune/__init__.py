"""Which models and lobes pay for their bytes."""
