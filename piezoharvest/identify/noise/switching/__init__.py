"""Errors of records behind diodes and switches: where these act earlier or later, and what a record has in common."""
