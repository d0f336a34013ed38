"""The front between harvested power and damping: designs none of which is better than another in both."""

from piezoharvest.design.front.point import Front, FrontPoint, overall
from piezoharvest.design.front.tracing import FrontTracer

__all__ = ["Front", "FrontPoint", "FrontTracer", "overall"]
