"""What tests of many random or extreme cases are made of: scenes, mutants, references, and judges of what comes out."""
