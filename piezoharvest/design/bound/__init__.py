"""Performance bound of passive, causal, linear shunts, by convex programs."""

from piezoharvest.design.bound.bounds import bound_in_band, bound_of, limits_along
from piezoharvest.design.bound.several import bound_of_several

__all__ = ["bound_in_band", "bound_of", "bound_of_several", "limits_along"]
