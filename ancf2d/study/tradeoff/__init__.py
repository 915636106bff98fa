"""Work and precision: the cost of settings of a case, and the size of their errors."""
