"""Noise of measured records: its size and colour, and the part of a measured drive that is none."""
