"""Mutants of case files and of result files, and the outcome of commands on them."""
