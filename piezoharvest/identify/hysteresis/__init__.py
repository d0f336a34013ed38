"""Prandtl-Ishlinskii hysteresis from records: loops, thresholds, and where operators stand when a record begins."""
