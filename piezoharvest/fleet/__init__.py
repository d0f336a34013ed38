"""Diagnoses of many campaigns, one after the other or side by side, collected in one table of verdicts."""

from piezoharvest.fleet.run import SUFFIXES, FleetResult, diagnose_fleet

__all__ = ["SUFFIXES", "FleetResult", "diagnose_fleet"]
