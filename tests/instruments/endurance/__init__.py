"""Many runs: at once, repeated, stopped at any moment, or without room on the disk."""
