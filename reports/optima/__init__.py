"""Is any random design better than a tuned one? Plants, random designs and the comparison."""
