"""Rods at rest, vibrating and let go, against solutions that share no line with the solver."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from featherfx.lab.experiments import bend
from featherfx.lab.oracles import elastica_tip
from featherfx.lab.rod import Rod
from featherfx.lab.study import StudyResult, bounded

SEGMENTS = 40


def elastica(folder: Path) -> StudyResult:
    """A clamped rod under a dead force across its tip."""
    rows = []
    for load in (0.5, 1.0, 2.0, 5.0, 10.0):
        x, drop = elastica_tip(load)
        tip = bend(Rod(1.0, 1.0, segments=SEGMENTS), (0.0, 0.0, -load)).tip
        error = float(np.linalg.norm(tip - [x, 0.0, -drop]))
        rows.append(bounded(f"tip error at F L^2 / EI = {load:g}", error, at_most=1e-3, unit="L"))
    return StudyResult(rows)
