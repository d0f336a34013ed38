"""Identification of Prandtl-Ishlinskii hysteresis from records: loops, thresholds, and initial states."""
