"""What a script needs to read values off the curves of a figure: where its axes are, and what they span."""

from __future__ import annotations

import re
from typing import Any

from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.ticker import EngFormatter

_POINTS = 72.0  # of an inch, in which SVG counts here


def axis_scales(figure: Figure) -> list[dict[str, Any]]:
    """Frame in points, as SVG counts them from the upper left corner, and scales of all axes, in their order.

    An axis has its `ends` in data at the left and right, or lower and upper, edge of the `frame` [left, top, right,
    bottom], whether it is logarithmic, the `label`, the `unit` that takes prefixes, and the `factor` of the data over
    what its labels count. Axes with another scale are None.
    """
    width, height = (inches * _POINTS for inches in figure.get_size_inches())
    found: list[Any] = []
    for axes in figure.axes:
        box = axes.get_position()
        frame = [box.x0 * width, (1 - box.y1) * height, box.x1 * width, (1 - box.y0) * height]
        x, y = _axis(axes, "x"), _axis(axes, "y")
        known = {x["scale"], y["scale"]} <= {"linear", "log"}
        found.append({"frame": [round(edge, 3) for edge in frame], "x": x, "y": y} if known else None)
    return found


def _axis(axes: Axes, name: str) -> dict[str, Any]:
    """Scale of the axis "x" or "y"; axes that share it may have its label."""
    axis: Axis = getattr(axes, f"{name}axis")
    shared = getattr(axes, f"get_shared_{name}_axes")().get_siblings(axes)
    labels = [getattr(other, f"get_{name}label")() for other in (axes, *shared)]
    ends, formatter = axis.get_view_interval(), axis.get_major_formatter()
    return {
        "ends": [float(end) for end in (reversed(ends) if axis.get_inverted() else ends)],
        "scale": axis.get_scale(),
        "label": _one_line(next(filter(None, labels), name)),
        "unit": formatter.unit if isinstance(formatter, EngFormatter) else None,
        "factor": getattr(formatter, "factor", 1.0),
    }


def _one_line(label: str) -> str:
    """Label without line breaks and remarks in parentheses."""
    return " ".join(re.sub(r"\(.*?\)", "", label).split())
