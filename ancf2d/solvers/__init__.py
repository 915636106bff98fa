"""Solvers: they take a model and yield states; they know nothing of files or terminals."""
