"""Flat memory of the compiled engine: the layout of its arrays, and linear algebra on them."""
