"""Identified specimens: the file that hands what records told to simulation and design, and draws from it."""

from piezoharvest.specimen.file import Specimen, load_specimen, write_specimen
from piezoharvest.specimen.intervals import intervals

__all__ = ["Specimen", "intervals", "load_specimen", "write_specimen"]
