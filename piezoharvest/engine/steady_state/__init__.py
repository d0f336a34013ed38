"""The periodic steady state by shooting, compiled, for one design or many."""
