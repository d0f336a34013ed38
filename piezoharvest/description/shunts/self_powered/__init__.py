"""Circuits whose switches power themselves: electronic breakers find the extrema of the electrode voltage."""
