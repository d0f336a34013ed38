"""Oracles: independent, slow and plain reimplementations that the tests compare piezoharvest with."""
