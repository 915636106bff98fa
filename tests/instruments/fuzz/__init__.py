"""Mutants of case files and of result files, and what the commands make of them."""
