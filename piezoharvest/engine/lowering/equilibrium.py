"""Equilibrium of a system under the static part of its excitation, the initial state of a simulation."""

from __future__ import annotations

import numpy as np

from piezoharvest.description.excitation import Excitation
from piezoharvest.description.parameters import COMPLEX_STEP, ParameterError
from piezoharvest.engine.lowering.layout import Layout, Physics, rows_of, stack
from piezoharvest.equations.rows import gains
from piezoharvest.equations.terms import SmoothElement

ROUNDING_SHARE = 1e-12  # of its terms: a sum below this counts as zero


def equilibrium(layout: Layout, physics: Physics, excitation: Excitation, scale: np.ndarray) -> np.ndarray:
    """Scaled states at rest under the static part of the excitation, the electrodes and all stops relaxed.

    States of the shunt have their initial values.
    """
    begins = stack([*[0.0] * (layout.n - len(layout.shunt_states)), *(s.initial for s in layout.shunt_states)]) / scale
    return begins + _at_rest(layout, physics, excitation, scale) if np.any(excitation.rest) else begins


def _at_rest(layout: Layout, physics: Physics, excitation: Excitation, scale: np.ndarray) -> np.ndarray:
    """Scaled states at rest, those of the shunt being zero."""
    count, device = 2 * len(layout.modes), physics.device
    own = np.delete(np.arange(layout.n - len(layout.shunt_states)), layout.stop_states)
    relaxed = [device.placing.v_t, *(physics.ports[number].v for number in layout.charged if number)]
    forms = rows_of([*physics.motion.equations, *relaxed, *device.equations], layout.width)
    rows = forms[..., own] * scale[..., None, own]
    forces = [0.0] * len(own)
    forces[1:count:2] = [gain * excitation.rest for gain in gains(physics.transducer, excitation.base)]
    size = np.max(np.abs(np.real(rows)), axis=-1, keepdims=True)
    found = np.linalg.solve(rows / size, stack(forces)[..., None] / size)[..., 0]
    if layout.smooth:
        smooth = [np.argmax(row) for row in layout.smooth.values()]
        inputs = physics.inputs()
        follows = np.linalg.solve(rows / size, -forms[..., smooth] / size)
        found = _nonlinear_equilibrium(
            layout.elements, found, follows, inputs[..., own] * scale[..., None, own], inputs[..., smooth]
        )
    rest = np.zeros((*found.shape[:-1], layout.n), found.dtype)
    rest[..., own] = found
    return rest


def _nonlinear_equilibrium(elements: list[SmoothElement], rest, follows, by_state, by_output) -> np.ndarray:
    """Equilibrium z = rest + follows w of every design, w being the outputs of smooth elements with these inputs."""
    batch, found = np.broadcast_shapes(rest.shape[:-1], follows.shape[:-2], by_state.shape[:-2]), []
    terms = by_state * rest[..., None, :]
    at_rest = terms.sum(axis=-1)
    # Without this the rounding error of a zero, as of the voltage behind a resistor, would be taken for its size.
    at_rest.real[np.abs(at_rest.real) < ROUNDING_SHARE * np.abs(terms).sum(axis=-1)] = 0.0
    parts = ((rest, 1), (follows, 2), (by_state @ follows + by_output, 2), (at_rest, 1))
    spread = (np.broadcast_to(part, batch + part.shape[-rank:]) for part, rank in parts)
    designs = zip(*(part.reshape(-1, *part.shape[len(batch) :]) for part in spread), strict=True)
    for design, (z, bend, inputs, at_rest) in enumerate(designs):
        found.append(z + bend @ _element_outputs(elements, design, inputs, at_rest))
    return np.reshape(found, batch + rest.shape[-1:])


def _element_outputs(elements: list[SmoothElement], design: int, inputs: np.ndarray, at_rest: np.ndarray) -> np.ndarray:
    """Outputs w of smooth elements whose inputs are inputs w + at_rest; time, which some of them take, is zero.

    With complex steps of a quantity their derivatives follow by the implicit function theorem.
    """
    from scipy.optimize import root

    def outputs(w: np.ndarray, inputs: np.ndarray, at_rest: np.ndarray) -> np.ndarray:
        pairs = zip(elements, (inputs @ w + at_rest).reshape(-1, 2), strict=True)
        return np.array([element.at_start(first, second, design) for element, (first, second) in pairs])

    def nominally(w: np.ndarray) -> np.ndarray:
        return np.real(outputs(w, *nominal))

    count, nominal = len(elements), (np.real(inputs), np.real(at_rest))
    size = np.abs(nominally(np.zeros(count)))
    # From where the outputs do not act on each other; away from there another equilibrium may be nearer.
    begin = np.where(size == 0.0, 0.0, 1.0)
    size[size == 0.0] = 1.0
    solved = root(lambda w: nominally(w * size) / size - w, begin, tol=1e-13)
    if not np.max(np.abs(solved.fun)) < 1e-9:
        raise ParameterError("excitation.offset", "there is no equilibrium under this preload, use a smaller one")
    found = solved.x * size
    step = np.imag(outputs(found, inputs, at_rest))
    if not np.any(step):
        return found
    own = np.imag(outputs(found, *nominal))  # of what elements are made of
    slopes = [
        (np.imag(outputs(found + 1j * COMPLEX_STEP * unit, *nominal)) - own) / COMPLEX_STEP for unit in np.eye(count)
    ]
    return found + 1j * np.linalg.solve(np.eye(count) - np.transpose(slopes), step)
