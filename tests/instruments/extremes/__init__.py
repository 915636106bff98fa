"""The map of extremes: cells as data, references of their own, verdicts, and the tables of docs/extremes.md."""
