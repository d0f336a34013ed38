"""Faults of a measurement that are settled before the search for effects: drives that saturate, a shifted zero."""
