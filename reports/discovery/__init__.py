"""How often a law without a name is found: campaigns made by SciPy with laws that are in no file of the package."""
