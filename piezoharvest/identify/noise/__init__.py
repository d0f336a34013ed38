"""Noise of measured records: its size and colour, and the separation of a measured drive from its noise."""
