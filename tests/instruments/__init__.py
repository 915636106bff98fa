"""Tools for tests of many random or extreme cases: scenes, mutants, references, and verdicts."""
