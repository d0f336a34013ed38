"""Derivatives of the periodic steady state with respect to the quantities of a model."""
