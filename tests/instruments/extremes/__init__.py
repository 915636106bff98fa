"""The map of extremes: cells as data, independent references, verdicts, and the tables of docs/extremes.md."""
