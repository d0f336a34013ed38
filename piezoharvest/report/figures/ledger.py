"""Figure of the energy balance: one stacked bar for each candidate."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from piezoharvest.report.figures import style
from piezoharvest.report.subjects import Subject
from piezoharvest.report.units import engineering

_COLOURS = {
    "harvested": style.PALETTE[2], "damping": "#9aa3ae", "hysteresis": style.PALETTE[3], "shunt_loss": style.PALETTE[1],
    "stored": style.PALETTE[5],
}  # fmt: skip
_NAMES = {
    "harvested": "harvested", "damping": "mechanical damping", "hysteresis": "hysteresis",
    "shunt_loss": "lost in the shunt", "stored": "still stored",
}  # fmt: skip
_OTHERS = (style.PALETTE[4], style.PALETTE[0])
_SUPPLY = ("mechanical_in", "source")
_MIN_LABELLED_SHARE = 0.055  # share from which a part of a bar is labelled with its percentage


@style.styled
def ledger(subjects: Sequence[Subject]) -> Figure:
    """Stacked horizontal bars, in percent of the energy supplied."""
    drawn = [(subject, shares(subject)) for subject in subjects if shares(subject)]
    figure, axes = style.grid_of_axes(1, height=1.0 + 0.36 * len(drawn))
    names = list(dict.fromkeys(name for _, parts in drawn for name in (*_NAMES, *parts) if parts.get(name)))
    for row, (subject, parts) in enumerate(drawn):
        _bar(axes, row, parts, names)
        axes.annotate(_total(subject), (1, row), xycoords=("axes fraction", "data"), xytext=(6, 0),
                      textcoords="offset points", va="center", fontsize=8, color=style.MUTED)  # fmt: skip
    axes.set_yticks(range(len(drawn)), [_name(subject) for subject, _ in drawn])
    axes.set_ylim(len(drawn) - 0.5, -0.5)
    axes.set_xlim(0, 100)
    axes.set_xlabel("share of the energy supplied in %")
    axes.grid(visible=False, axis="y")
    axes.spines["left"].set_visible(False)
    axes.tick_params(axis="y", length=0)
    handles = [Patch(facecolor=colour_of(name, names), label=name_of(name)) for name in names]
    style.legend_above(figure, handles, 5)
    return figure


def shares(subject: Subject) -> Mapping[str, float]:
    """Share of each entry in the supplied energy; empty where nothing was supplied."""
    energy = subject.response.energy if subject.response else {}
    supplied = sum(energy.get(name, 0.0) for name in _SUPPLY) + max(-energy.get("stored", 0.0), 0.0)
    spent = {name: value for name, value in energy.items() if name not in (*_SUPPLY, "closure") and value > 0}
    return {name: value / supplied for name, value in spent.items()} if supplied > 0 else {}


def name_of(entry: str) -> str:
    """Words for an entry of the energy balance; effects by their own name."""
    return _NAMES.get(entry, entry.replace("_", " "))


def colour_of(entry: str, names: Sequence[str]) -> str:
    """Colour of an entry, the same in every bar."""
    others = [name for name in names if name not in _COLOURS]
    return _COLOURS[entry] if entry in _COLOURS else _OTHERS[others.index(entry) % len(_OTHERS)]


def _bar(axes: Axes, row: int, parts: Mapping[str, float], names: Sequence[str]) -> None:
    left = 0.0
    for name in names:
        width = 100 * parts.get(name, 0.0)
        axes.barh(row, width, left=left, height=0.66, color=colour_of(name, names), linewidth=0)
        if width >= 100 * _MIN_LABELLED_SHARE:
            axes.text(left + width / 2, row, f"{width:.0f}", ha="center", va="center", fontsize=8, color="#101418")
        left += width


def _name(subject: Subject) -> str:
    return subject.label if subject.candidate.converged else f"{subject.label}\n(not trusted)"


def _total(subject: Subject) -> str:
    assert subject.response is not None
    return f"of {engineering(sum(subject.response.energy.get(name, 0.0) for name in _SUPPLY), 'J')}"
