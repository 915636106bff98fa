"""How the results of solvers change with the numbers of a case."""
