"""How what solvers find changes with the numbers of a case."""
