"""The places of docs/ that scripts fill with what they measured, and what these figures belong to."""

from scripts.pages import DOCS, stamp, write

__all__ = ["DOCS", "stamp", "write"]
