"""Run folders: written whole or not at all, resumable, and those of edited models."""
