"""Circuits from net lists of ngspice and LTspice: `reading.py` has the language, `spice.py` the shunt."""
