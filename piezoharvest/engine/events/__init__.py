"""Events: location of a guard's zero crossing, and its effect on diodes, switches and stop operators."""
