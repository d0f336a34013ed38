"""Channels of the bench: their columns, and the noise of their sensors in SI units."""

COLUMN = {"displacement": "displacement_m", "voltage": "voltage_V", "current": "current_A"}
NOISE = {"displacement": 1.5e-8, "voltage": 1.5e-3, "current": 3.5e-8}
