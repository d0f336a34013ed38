"""How often the diagnosis names the right cause: random campaigns of the virtual bench whose cause it is not told."""
