"""Skin, eyes and colliders beside the feathers of a cache, as the viewer takes them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from featherfx.render.subject import scenery_of_shot
from featherfx.usd.read.cache import Cache
from featherfx.view.packing import packed_colours, packed_points


class SceneryMeshes:
    """The meshes that a cache at a path names, as pictures have them; a warning tells what is not
    there. points: of all of them, 0 where there are none."""

    def __init__(self, cache: Cache, path: Path) -> None:
        # what the camera is to see of it comes first
        self._meshes = sorted(scenery_of_shot(cache, path), key=lambda each: not each.framed)
        self._counts = [int(each.scene.starts[-1]) for each in self._meshes]

    @property
    def points(self) -> int:
        return sum(self._counts)

    def header(self) -> dict[str, Any] | None:
        """Describe the meshes for the viewer; None where there are none. framed: number of points,
        the first, that the camera is to see."""
        if not self._meshes:
            return None
        pairs = zip(self._meshes, self._counts, strict=True)
        return {
            "points": self.points,
            "triangles": sum(len(each.scene.triangles) for each in self._meshes),
            "levels": [],
            "framed": sum(count for each, count in pairs if each.framed),
        }

    def constant(self) -> bytes:
        """Corners (3 uint32 a triangle) and a colour a point (3 bytes)."""
        starts = np.cumsum([0, *self._counts])
        pairs = zip(self._meshes, starts[:-1], strict=True)
        corners = np.concatenate([each.scene.triangles + start for each, start in pairs])
        colours = np.concatenate([each.colours() for each in self._meshes])
        return corners.astype("<u4").tobytes() + packed_colours(colours)

    def frame(self, code: float | None) -> bytes:
        """Its points at a time code of the cache; None: at rest."""
        return packed_points(np.concatenate([each.points(code) for each in self._meshes]))
