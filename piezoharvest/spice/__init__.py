"""Export of a system as a netlist that ngspice and LTspice run as it is."""

from piezoharvest.spice.export import export_spice

__all__ = ["export_spice"]
