"""A figure for the page of each shunt: its voltages and current in the steady state, on the bench of the tests."""

from __future__ import annotations

import io
from collections.abc import Iterator

import numpy as np

from made_from_code.project import ROOT
from piezoharvest.description import shunts
from piezoharvest.description.excitation import SineForce
from piezoharvest.description.shunts import Shunt
from piezoharvest.description.system import System
from piezoharvest.description.transducer import Transducer
from piezoharvest.engine import simulate
from piezoharvest.engine.response import Response
from piezoharvest.report.figures import style
from piezoharvest.report.subjects import values_of
from piezoharvest.report.units import engineering

BENCH = {"mass": 0.010, "damping": 0.0628, "stiffness": 986.96, "coupling": 1.0e-3, "capacitance": 40e-9}
DRIVE = SineForce(amplitude=0.02, frequency=50.6)


def figures(examples: dict[str, Shunt]) -> Iterator[tuple[str, str, bytes]]:
    """Kind, caption in Markdown and picture (PNG) of each shunt of the package for which there is an example."""
    for kind, cls in shunts.registered().items():
        if kind not in examples or not cls.__module__.startswith("piezoharvest."):
            continue
        response = simulate(System(Transducer(**BENCH), examples[kind]), DRIVE)
        if response.converged and response.waveforms is not None:
            stream = io.BytesIO()
            style.write_png(_drawn(response), stream)
            yield kind, _caption(examples[kind], response), stream.getvalue()


def _caption(shunt: Shunt, response: Response) -> str:
    values = ", ".join(f"{symbol} = {value}" for symbol, value in values_of(shunt))
    power = f" It harvests {engineering(response.harvested_power, 'W')}." if response.harvested_power > 0 else ""
    return (
        f"Steady state of a strongly coupled example (k_e² = 0.025, Q_m = 50, 40 nF; 0.02 N at 50.6 Hz)"
        f"{f' with {values}' if values else ''}.{power} Dashed: displacement, in its own scale."
    )


@style.styled
def _drawn(response: Response):
    figure, (upper, lower) = style.grid_of_axes(2, height=3.6, sharex=True)
    waves = response.waveforms
    assert waves is not None
    period = 1 / DRIVE.frequency
    time = 1e3 * np.append(waves.time, waves.time + period)

    def twice(values):
        return np.tile(values, 2)

    scale = np.max(np.abs(waves.voltage)) / np.max(np.abs(waves.displacement)) or 1.0
    handles = upper.plot(
        time, twice(waves.displacement) * scale, color=style.MUTED, linestyle="--", label="displacement"
    )
    handles += upper.plot(time, twice(waves.voltage), color=style.PALETTE[0], label="electrode voltage")
    if waves.dc_voltage is not None:
        handles += upper.plot(time, twice(waves.dc_voltage), color=style.PALETTE[1], label="dc voltage")
    factor, unit = (1e6, "µA") if np.max(np.abs(waves.current)) < 1e-3 else (1e3, "mA")
    lower.plot(time, factor * twice(waves.current), color=style.PALETTE[0])
    upper.set(ylabel="voltage in V")
    lower.set(xlabel="time in ms", ylabel=f"current in {unit}", xlim=(0.0, 2e3 * period))
    style.legend_above(figure, handles)
    return figure


def examples() -> dict[str, Shunt]:
    """The plainest example of each shunt that the tests have, with a load where it may have one."""
    import sys

    sys.path[:0] = [str(ROOT / "tests"), str(ROOT / "tests/conformance")]
    from examples import GIVEN, plain_examples  # pyright: ignore[reportMissingImports]

    own = {kind: cls for kind, cls in shunts.registered().items() if cls.__module__.startswith("piezoharvest.")}
    found = {kind: plain_examples(cls, GIVEN.get(kind, {})) for kind, cls in own.items()}
    return {kind: next(filter(_loaded, some), some[0]) for kind, some in found.items()}


def _loaded(shunt: Shunt) -> bool:
    return getattr(shunt, "load_resistance", None) is not None
