"""Pictures of studies, where matplotlib (the optional extra `plots`) is installed."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from featherfx.lab.bench.tables import can_plot
from featherfx.lab.studies.study import Figure

INCHES = (7.0, 4.6)
DOTS = 110
# Okabe and Ito's, told apart by the colour-blind too
COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00")


def draw(
    file: Path,
    caption: str,
    paint: Callable[[Any], None],
    inches: tuple[float, float] = INCHES,
) -> tuple[Figure, ...]:
    """Write a PNG that paint draws on an empty matplotlib Figure; () without matplotlib."""
    if not can_plot():
        return ()
    from matplotlib import rc_context
    from matplotlib.figure import Figure as Canvas

    file.parent.mkdir(parents=True, exist_ok=True)
    with rc_context({"axes.prop_cycle": f"cycler('color', {list(COLOURS)})"}):
        canvas = Canvas(figsize=inches, layout="constrained")
        paint(canvas)
        # no version or date inside: the same numbers give the same file
        canvas.savefig(file, format="png", dpi=DOTS, metadata={"Software": None})
    return (Figure(file, caption),)
