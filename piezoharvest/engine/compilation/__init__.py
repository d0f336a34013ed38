"""Compilation of the engine by numba, and the cache of compiled code on disk."""
