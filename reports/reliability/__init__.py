"""How hard the engine is to break: random studies of every shunt and effect, over twelve decades, kept and counted."""
