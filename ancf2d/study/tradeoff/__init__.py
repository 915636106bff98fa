"""Work and precision: what settings of a case cost and how far off they are."""
