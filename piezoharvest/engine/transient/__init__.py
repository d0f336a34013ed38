"""Sampled outputs of a run through a signal, with their derivatives with respect to quantities and initial states."""
