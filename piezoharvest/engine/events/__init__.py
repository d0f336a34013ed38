"""Events: when a guard rises, and what then happens to diodes, switches and stop operators."""
