"""Linear models and measured responses to and from python-control, scipy.signal and scikit-rf."""

from piezoharvest.exchange.responses import response_record, to_frd, two_port_from
from piezoharvest.exchange.shunts import shunt_from
from piezoharvest.exchange.touchstone import to_network, write_touchstone
from piezoharvest.exchange.transducers import transducer_from

__all__ = [
    "response_record",
    "shunt_from",
    "to_frd",
    "to_network",
    "transducer_from",
    "two_port_from",
    "write_touchstone",
]
