"""Start values of linear circuits that act together, each at electrodes of its own.

Each circuit has the closed forms of its electrodes, for every mode of the band. Which of them go together is found by
exchanging one circuit's values at a time for the best of its closed forms, as long as that helps.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace

from piezoharvest.design.drafts import Draft
from piezoharvest.design.linear_view import LinearView
from piezoharvest.design.places import split
from piezoharvest.design.tuning.starts import Host, Start, starts

_SWEEPS = 4  # of exchanges; two are mostly enough
_MOST_MODES = 3  # for which each circuit has closed forms


def joint_starts(view: LinearView, draft: Draft, host: Host) -> list[Start]:
    """Start values of a linear circuit and of its others, those of `starts` where it has none."""
    if not draft.shunt.others:
        return starts(draft, host)
    branches = [found for found in _branches(draft, host) if found]
    found: list[Start] = []
    for place in (0, -1):  # from the first closed form of every circuit, and from the last
        best = _exchanged(view, draft, branches, [options[place] for options in branches])
        if best not in found:
            found.append(best)
    return found


def _branches(draft: Draft, host: Host) -> Iterator[list[Start]]:
    """Closed forms of each circuit by itself, its fields under their names in the draft."""
    for prefix, shunt in draft.branches():
        names = [name for of, name in map(split, draft.free) if of == prefix]
        alone = Draft(replace(shunt, others=()), tuple(names))
        hosts = _for_modes(host.beside.get(shunt.electrode, host)) if names else []
        found = [start for each in hosts for start in starts(alone, each)]
        yield [Start(start.formula, {prefix + name: start.values[name] for name in names}) for start in found]


def _for_modes(host: Host) -> list[Host]:
    """The host at its mode, and at the other ones of the band."""
    further = [pair for pair in host.modes if pair != (host.short, host.opened)][: _MOST_MODES - 1]
    at = [replace(host, short=s, opened=o, coupling=(o**2 - s**2) / s**2) for s, o in further]
    return [host, *at]


def _exchanged(view: LinearView, draft: Draft, branches: list[list[Start]], chosen: list[Start]) -> Start:
    """The best combination that is found by exchanging one circuit's values at a time."""

    def together(starts: list[Start]) -> Mapping[str, float]:
        return {name: value for start in starts for name, value in start.values.items()}

    def merit(n: int, option: Start) -> float:
        trial = [*chosen[:n], option, *chosen[n + 1 :]]
        return view.merit(draft.with_values(together(trial)))

    for _ in range(_SWEEPS):
        before = list(chosen)
        for n, options in enumerate(branches):
            chosen[n] = min(options, key=lambda option, n=n: merit(n, option))
        if chosen == before:
            break
    formulas = dict.fromkeys(start.formula for start in chosen)
    return Start("; ".join(formulas), dict(together(chosen)))
