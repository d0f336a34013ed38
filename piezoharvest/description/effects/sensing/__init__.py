"""Effects in the sensors, their wiring and the load."""
