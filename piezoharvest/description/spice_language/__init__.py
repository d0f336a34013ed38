"""The language of net lists of ngspice and LTspice: `expressions.py` has its values, `reading.py` its lines."""
