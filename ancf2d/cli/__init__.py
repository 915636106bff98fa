"""The command line: parse, call one function, map what happens to exit codes."""

from .app import app as main

__all__ = ["main"]
