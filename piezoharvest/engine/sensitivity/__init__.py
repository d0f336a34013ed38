"""Derivatives of the periodic steady state by the quantities of a model."""
