"""Robustness: worst case over intervals of the quantities, and the design that is best in its worst case."""
