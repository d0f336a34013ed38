"""Shunts with a controller as netlist elements."""
