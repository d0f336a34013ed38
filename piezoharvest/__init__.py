"""Control-systems toolbox for piezoelectric shunt damping and energy harvesting."""

__version__ = "0.1.0"
