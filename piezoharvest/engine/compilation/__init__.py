"""How the engine is compiled by numba, and how compiled code is kept on disk."""
