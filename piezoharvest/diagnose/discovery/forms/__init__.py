"""From a curve to a formula: readable forms for a table, the names of known effects, and a law in words."""
