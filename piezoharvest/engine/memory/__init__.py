"""Flat memory of the compiled engine: where each array stands, and linear algebra on it."""
