"""Looks at a BTF before hours are spent on a fit: what is odd about its values, and what to do."""

from .page import Finding, check_btf

__all__ = ["Finding", "check_btf"]
