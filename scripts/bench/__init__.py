"""Speed: what docs/speed.md and the times in docs/modes.md are measured with."""
