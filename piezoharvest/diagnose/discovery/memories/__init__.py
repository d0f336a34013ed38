"""Laws with a memory: straight lines of what it makes of an input, and other functions of that."""
