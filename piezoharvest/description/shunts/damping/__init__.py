"""Switched shunts that damp a vibration."""
