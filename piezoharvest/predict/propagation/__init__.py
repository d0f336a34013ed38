"""Compiled propagation over the samples of a record."""
