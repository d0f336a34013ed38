"""Tuning of the free parts of a shunt: start values, on the exact two-port, and by simulation."""
