"""Exact motion within one linear mode: its tables of matrix exponentials, its forms and its energies."""
