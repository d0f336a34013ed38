"""Propagation through time: within a mode up to the next event, through the event, with recording."""
