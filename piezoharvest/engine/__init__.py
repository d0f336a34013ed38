"""The event-driven engine: exact propagation of piecewise linear models."""
