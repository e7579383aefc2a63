"""The error that a simulation is estimated to have, in the frame loop."""

from __future__ import annotations

from typing import Any

from featherfx.shot.loop.error_estimate import ErrorEstimate
from featherfx.shot.loop.run import Stage


class ErrorStage(Stage):
    """Estimated error of the feathers that are simulated in full."""

    def prepare(self) -> None:
        """Keep rest shapes and lengths of the feathers of each batch."""
        self._estimate = ErrorEstimate(self.run.options, self.run.groups)

    def note(self, index: int) -> None:
        """Take the poses of a frame, and the steps on the way to it, into account."""
        if index >= 0:
            self._estimate.note()
        for group in self.run.groups:
            if group.report is not None:
                self._estimate.stepped(group, group.report)

    def report(self) -> dict[str, Any]:
        """Error that is estimated and promised, percent of the length; feathers with several rest
        poses, ids by kind (undefined)."""
        undefined: dict[str, list[str]] = {}
        for group in self.run.groups:
            for f in group.members[group.several].tolist():
                placement = self.run.shot.groom.feathers[f]
                undefined.setdefault(placement.kind.name, []).append(placement.id)
        return self._estimate.report() | ({"undefined": undefined} if undefined else {})
