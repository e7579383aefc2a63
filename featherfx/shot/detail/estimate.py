"""The error that a simulation is estimated to have: by how far feathers bend, and by its steps."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from featherfx.algebra.types import Array
from featherfx.feather.types import RowPoints, stacked
from featherfx.shot.detail.promise import front
from featherfx.shot.groups import Group
from featherfx.shot.types import Shot
from featherfx.solver.solver import StepReport


class Estimate:
    """Kept up frame by frame, of the feathers that are simulated in full.

    Nothing is kept of frames that another simulation computed.
    """

    def __init__(self, shot: Shot, groups: Sequence[Group]) -> None:
        self._promised = shot.quality.promised
        self._groups = {id(group): group for group in groups if group.level == "full"}
        self._rest = {k: stacked([f.rest for f in g.feathers]) for k, g in self._groups.items()}
        # of the length: largest deflections of shaft and barbs, and largest error of a step
        self._worst = {k: np.zeros((len(g.members), 3)) for k, g in self._groups.items()}

    def note(self) -> None:
        """Take the poses of a frame into account."""
        for k, group in self._groups.items():
            for j, bent in enumerate(bends(self._rest[k], group.state.points)):
                self._worse(group, j, bent)

    def stepped(self, group: Group, report: StepReport) -> None:
        """Take the steps of a batch into account."""
        if id(group) in self._groups:
            self._worse(group, 2, report.error)

    def _worse(self, group: Group, member: int, found: Array) -> None:
        worst = self._worst[id(group)][:, member]
        np.maximum(worst, found / [f.station[-1] for f in group.feathers], out=worst)

    def report(self) -> dict[str, Any]:
        """Of a bake's report, percent of the length: the error that was promised, if any was, and
        the largest that is estimated. Empty where nothing is simulated in full."""
        if not self._groups:
            return {}
        worst = max(float(each.max()) for each in self.errors())
        promised = {} if self._promised is None else {"error_promised": 100.0 * self._promised}
        return promised | {"error_estimated": 100.0 * worst}

    def errors(self) -> list[Array]:
        """Per batch (F,), of the length."""
        known, found = front(), []
        for k, group in self._groups.items():
            shaft, barb, step = self._worst[k].T
            n, m, c = group.resolution.rows, group.resolution.columns, group.resolution.coefficients
            space = (
                known.rows.estimated(n, shaft)
                + known.columns.estimated(m, barb)
                + known.coefficients.estimated(max(c, 1), barb)
            )
            found.append(np.hypot(space, known.of_steps(step)))
        return found


def bends(rest: RowPoints, now: RowPoints) -> tuple[Array, Array]:
    """(F,) m, how far shafts are from where their roots would carry them, and ends of barbs from
    where their rows would; largest of each feather.

    rest, now: nodes (F, n, 1 + 2 m, 3) and directors (F, n, 2, 3).
    """
    before, after = _frames(rest), _frames(now)
    m = (rest.nodes.shape[2] - 1) // 2
    shaft = rest.nodes[:, :, 0] - rest.nodes[:, :1, 0]
    carried = np.einsum("fki,fnk->fni", before[:, 0], shaft)
    moved = np.einsum("fki,fnk->fni", after[:, 0], now.nodes[:, :, 0] - now.nodes[:, :1, 0])
    barbs = rest.nodes[:, :, (m, 2 * m)] - rest.nodes[:, :, :1]
    own = np.einsum("fnki,fnpk->fnpi", before, barbs)
    ends = now.nodes[:, :, (m, 2 * m)] - now.nodes[:, :, :1]
    turned = np.einsum("fnki,fnpk->fnpi", after, ends)
    return _largest(moved - carried), _largest(turned - own)


def _frames(points: RowPoints) -> Array:
    """(F, n, 3, 3) of rows, whose second index counts the axes x, y and z of the world."""
    second, third = points.directors[:, :, 0], points.directors[:, :, 1]
    return np.stack([np.cross(second, third), second, third], axis=-1)


def _largest(ways: Array) -> Array:
    return np.asarray(np.linalg.norm(ways, axis=-1).reshape(len(ways), -1).max(axis=1))
