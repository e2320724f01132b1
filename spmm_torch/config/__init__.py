"""Typed settings with ranges, read from and written to YAML."""
