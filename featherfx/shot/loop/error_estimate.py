"""The error that a simulation is estimated to have: by how far feathers bend, and by its steps."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from featherfx.algebra.types import Array
from featherfx.feather.types import RowPoints, stacked
from featherfx.shot.loop.groups import FeatherGroup
from featherfx.shot.options.error_model import error_model
from featherfx.shot.options.options import ShotOptions
from featherfx.solver.solver import StepReport


class ErrorEstimate:
    """Error of the feathers that are simulated in full, kept up frame by frame.

    options: of all feathers. Nothing is kept of frames that another simulation computed.
    """

    def __init__(self, options: ShotOptions, groups: Sequence[FeatherGroup]) -> None:
        self._options = options
        self._groups = {id(group): group for group in groups if group.level == "full"}
        self._rest = {
            k: _ends(stacked([f.rest for f in g.feathers])) for k, g in self._groups.items()
        }
        self._lengths = {
            k: np.array([f.station[-1] for f in g.feathers]) for k, g in self._groups.items()
        }
        self._air = {k: options.air[g.members] for k, g in self._groups.items()}
        # of the length: largest deflection of barbs, and largest error of a step
        self._worst = {k: np.zeros((len(g.members), 2)) for k, g in self._groups.items()}

    def note(self) -> None:
        """Take the poses of a frame into account."""
        for k, group in self._groups.items():
            self._worse(group, 0, _largest(_ends(group.state.points) - self._rest[k]))

    def stepped(self, group: FeatherGroup, report: StepReport) -> None:
        """Take the steps of a batch into account."""
        if id(group) in self._groups:
            self._worse(group, 1, report.error)

    def _worse(self, group: FeatherGroup, part: int, found: Array) -> None:
        worst = self._worst[id(group)][:, part]
        np.maximum(worst, found / self._lengths[id(group)], out=worst)

    def report(self) -> dict[str, Any]:
        """Return the part of a bake's report, percent of the length: the error that was promised,
        or why none is, and the largest that is estimated. Empty where nothing is simulated in full.
        """
        if not self._groups:
            return {}
        error, found = self._options.promised_error, dict[str, Any]()
        if error is None:
            found = {"error_promised": None, "error_not_promised": self._options.why_not_promised}
        else:
            found = {"error_promised": 100.0 * error}
        worst = max(float(each.max()) for each in self.errors())
        return found | {"error_estimated": 100.0 * worst}

    def errors(self) -> list[Array]:
        """Per batch (F,), of the length."""
        known, found = error_model(), []
        for k, group in self._groups.items():
            barb, step = self._worst[k].T
            own = group.options
            grid = own.rows, own.columns, max(own.coefficients, 1)
            steps = known.steps.by(step, self._air[k])
            found.append(np.hypot(known.after.by(grid, barb), steps))
        return found


def barb_bends(rest: RowPoints, now: RowPoints) -> Array:
    """(F,) m, how far ends of barbs are from where their rows would carry them; largest of each
    feather.

    rest, now: nodes (F, n, 1 + 2 m, 3) and directors (F, n, 2, 3).
    """
    return _largest(_ends(now) - _ends(rest))


def _ends(points: RowPoints) -> Array:
    """(F, n, 2, 3) m, ends of barbs as their rows see them."""
    m = (points.nodes.shape[2] - 1) // 2
    ends = points.nodes[:, :, (m, 2 * m)] - points.nodes[:, :, :1]
    return np.asarray(np.einsum("fnki,fnpk->fnpi", _frames(points), ends))


def _frames(points: RowPoints) -> Array:
    """(F, n, 3, 3) of rows, whose second index counts the axes x, y and z of the world."""
    second, third = points.directors[:, :, 0], points.directors[:, :, 1]
    return np.stack([np.cross(second, third), second, third], axis=-1)


def _largest(ways: Array) -> Array:
    return np.asarray(np.linalg.norm(ways, axis=-1).reshape(len(ways), -1).max(axis=1))
