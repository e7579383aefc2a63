"""Pictures of studies, where matplotlib (the optional extra `plots`) is installed."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from featherfx.lab.bench.tables import can_plot
from featherfx.lab.study import Figure

INCHES = (7.0, 4.6)
DOTS = 110


def draw(
    file: Path,
    caption: str,
    paint: Callable[[Any], None],
    inches: tuple[float, float] = INCHES,
) -> tuple[Figure, ...]:
    """Write a PNG that paint draws on an empty matplotlib Figure; () without matplotlib."""
    if not can_plot():
        return ()
    from matplotlib.figure import Figure as Canvas

    canvas = Canvas(figsize=inches, layout="constrained")
    paint(canvas)
    # no version or date inside: the same numbers give the same file
    canvas.savefig(file, format="png", dpi=DOTS, metadata={"Software": None})
    return (Figure(file, caption),)
