"""The language of netlists of ngspice and LTspice: `expressions.py` has its values, `reading.py` its lines."""
