"""Run folders: made whole or not at all, gone on with after a stop, and those of edited models."""
