"""Performance bound of passive, causal, linear shunts, by convex programs."""

from piezoharvest.design.bound.bounds import bound_in_band, bound_of, limits_along

__all__ = ["bound_in_band", "bound_of", "limits_along"]
