"""Lowering: matrices of the linear modes of a system under an excitation."""
