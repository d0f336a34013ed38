"""Figure of a law without a name: its curve with its band over what the records visited."""

from __future__ import annotations

from matplotlib.figure import Figure

from piezoharvest.diagnose.discovery.result import Discovery
from piezoharvest.report.figures import style
from piezoharvest.report.units import prefix_of

BAND_ERRORS = 3.0  # standard errors of the band: 99.7 % of a normal distribution


@style.styled
def law_figure(law: Discovery) -> Figure:
    """Draw what a law adds at its place against its input, with a band of three standard errors."""
    place = law.law.place
    figure, axes = style.grid_of_axes(1, height=2.9)
    x, y, band = law.input, law.value, BAND_ERRORS * law.std
    fx, x_unit = prefix_of(float(abs(x).max()), place.input_unit)
    fy, y_unit = prefix_of(float((abs(y) + band).max()), place.unit)
    axes.fill_between(fx * x, fy * (y - band), fy * (y + band), color=style.PALETTE[2], alpha=0.3, linewidth=0)
    axes.plot(fx * x, fy * y, color=style.PALETTE[0])
    axes.axhline(0.0, color=style.MUTED, linewidth=0.7)
    name = place.input.replace("_", " ")
    axes.set_xlabel(f"{name} ({x_unit})" if x_unit else f"{name} (share of the record)")
    axes.set_ylabel(f"added at the {style.plain(place.name.replace('.', ' of '))}" + (f" ({y_unit})" if y_unit else ""))
    return figure
