"""The demo: a design, its first measurement, the cause of what is missing, and the design redone with it."""
