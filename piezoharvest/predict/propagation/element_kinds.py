"""Codes of the kinds of scalar elements, in a file of their own: compiled code is made anew where one of its files is.

From CURVE on, the code of a curve is added.
"""

from __future__ import annotations

STOP, PRODUCT, POWER, POSITIVE_POWER, HINGE, SQUARED_HINGE, CURVE = range(7)
