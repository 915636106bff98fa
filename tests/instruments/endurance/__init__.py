"""Runs that are many, at once, repeated, stopped at any moment, or left without room on the disk."""
