"""Work and precision: what settings of a case cost, and how large their errors are."""
