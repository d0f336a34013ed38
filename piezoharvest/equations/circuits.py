"""Shunts in the equations: one at the electrodes of its number, others beside it at further electrodes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from types import SimpleNamespace

from piezoharvest.description.circuit import Port, Product, Row, State
from piezoharvest.description.shunts.base import Shunt
from piezoharvest.description.system import System
from piezoharvest.equations.rows import Ports, own_rows

CONFIGURATION = "linear"  # the only one of a linear circuit


def circuit_states(system: System) -> tuple[State, ...]:
    """States of the shunt under their names, then those of the others with the number of their electrodes."""
    electrodes, shunt = system.transducer.all_electrodes, system.shunt
    found = list(shunt.states(system.electrode.capacitance))
    for other in shunt.others:
        states = other.states(electrodes[other.electrode].capacitance)
        found += [state._replace(name=_prefix(other) + state.name) for state in states]
    return tuple(found)


def circuit_equations(
    shunt: Shunt, configuration: str, ports: Ports, z: SimpleNamespace, dz: SimpleNamespace
) -> tuple[list[Row], list[Row]]:
    """Equations of the ports whose charges are states, and those of the circuits' states, in these orders."""
    first, *own = shunt.equations(configuration, ports[shunt.electrode], z, dz)
    found = {shunt.electrode: first}
    for other, port, rows, rates in _others(shunt, ports, z, dz):
        found[other.electrode], *more = other.equations(CONFIGURATION, port, rows, rates)
        own += more
    return [found.get(number, ports[number].i) for number in ports.charged], own


def circuit_powers(
    shunt: Shunt, configuration: str, ports: Ports, z: SimpleNamespace
) -> Mapping[str, Sequence[Product]]:
    """Power of the shunt and of the others by destination; what control takes is lost, and not harvested."""
    port = ports[shunt.electrode]
    found = {key: list(products) for key, products in shunt.powers(configuration, port, z).items()}
    for product in shunt.control(port):
        found.setdefault("harvested", []).append(product._replace(coefficient=-product.coefficient))
        found.setdefault("shunt_loss", []).append(product)
    for other, port, rows, _ in _others(shunt, ports, z, z):
        for key, products in other.powers(CONFIGURATION, port, rows).items():
            found.setdefault(key, []).extend(products)
    return found


def _others(
    shunt: Shunt, ports: Ports, z: SimpleNamespace, dz: SimpleNamespace
) -> Iterator[tuple[Shunt, Port, SimpleNamespace, SimpleNamespace]]:
    """Each of the other shunts with its port, and rows of its states and their rates under its own names."""
    for other in shunt.others:
        port = ports[other.electrode]
        states = other.states(port.capacitance)
        rows, rates = (own_rows(vars(each), _prefix(other), states) for each in (z, dz))
        yield other, port, rows, rates


def _prefix(other: Shunt) -> str:
    """Prefix of the names of a shunt's states beside those of others."""
    return f"electrode{other.electrode}_"
