"""The layers of a shot in the frame loop: what was simulated is laid over what is beneath it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from numpy.typing import NDArray

from featherfx.algebra.types import Array
from featherfx.shot.frames import FeatherPose, StackingOrder
from featherfx.shot.layers.crossed import warn_of_crossed
from featherfx.shot.layers.layers import LayeredPlumage
from featherfx.shot.loop.run import Arrays, LayerStage, ShotRun


class ShotLayers(LayerStage):
    """Layers of the wanted feathers of a shot, and of all that lie beneath them."""

    name = "layers"

    def __init__(self, run: ShotRun) -> None:
        super().__init__(run)
        self._layers = LayeredPlumage(run.shot, run.drawn, run.wanted, run.jobs)
        self._wanted = run.wanted
        run.pose_also(self._layers.needed)
        assert run.shot.layers is not None
        self.samples_ahead = run.shot.layers.samples_ahead(run.time(1))
        if run.shot.contact is None:
            warn_of_crossed(run.shot, run.drawn, self._layers.needed, self._layers.stack)

    def skin(self, time: float) -> Array:
        """(V, 3) m, the skin beneath at a time in s."""
        return self._layers.skin(time)

    def ask(
        self, poses: list[FeatherPose], skin: Array, duration: float, accelerations: bool
    ) -> None:
        """Take in the posed feathers of a sample."""
        self._layers.ask(poses, skin, duration, accelerations)

    def lay(self, frame: float) -> list[FeatherPose]:
        """Poses of the wanted feathers at the first sample that was not laid yet."""
        return self._layers.of(self._wanted, self._layers.lay(frame))

    @property
    def laid(self) -> StackingOrder:
        """Stacking order of the feathers."""
        return self._layers.laid

    def checkpoint(self) -> Arrays:
        """Lifts of the sample that was laid last."""
        return self._layers.memory()

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Go on from a checkpoint."""
        self._layers.restore(arrays)

    def report(self) -> dict[str, Any]:
        """Figures of what was laid so far."""
        return self._layers.report()
