"""Maps from what is simulated to what is drawn, of many shapes; kept, since each takes long."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from featherfx.algebra.sparse import Rows
from featherfx.feather.build import build_feather
from featherfx.feather.density import density_map
from featherfx.feather.types import PointMap, RowMap
from featherfx.files.disk_cache import Arrays, kept
from featherfx.groom.types import FeatherKind

Grid = tuple[int, int]


def unit_maps(shapes: Sequence[tuple[FeatherKind, bool]], coarse: Grid, fine: Grid) -> list[RowMap]:
    """The density map of each shape, a kind and whether it is mirrored, from a grid (rows and
    columns) to another one."""
    if not shapes:
        return []

    def compute() -> Arrays:
        return _packed(
            [
                density_map(
                    build_feather(kind, *coarse, mirrored), build_feather(kind, *fine, mirrored)
                )
                for kind, mirrored in shapes
            ]
        )

    return _unpacked(kept("maps", [tuple(shapes), coarse, fine], compute), len(shapes))


def _packed(maps: Sequence[RowMap]) -> Arrays:
    """The arrays of one name of all maps end to end, and their sizes."""
    found: dict[str, Any] = {"pieces": np.stack([each.pieces for each in maps])}
    for name in ("nodes", "directors"):
        own = [getattr(each, name) for each in maps]
        found[f"{name}.widths"] = np.array([each.width for each in own])
        found[f"{name}.shapes"] = np.array([each.shape for each in own])
        for part in Rows._fields:
            arrays = [getattr(each.matrix, part) for each in own]
            found[f"{name}.{part}"] = np.concatenate(arrays)
            found[f"{name}.{part}.ends"] = np.cumsum([len(each) for each in arrays])
    return found


def _unpacked(arrays: Mapping[str, Any], count: int) -> list[RowMap]:
    """Invert _packed."""
    parts = {}
    for name in ("nodes", "directors"):
        cut = [
            np.split(arrays[f"{name}.{part}"], arrays[f"{name}.{part}.ends"][:-1])
            for part in Rows._fields
        ]
        parts[name] = [
            PointMap(
                Rows(*each),
                tuple(arrays[f"{name}.shapes"][k].tolist()),
                int(arrays[f"{name}.widths"][k]),
            )
            for k, each in enumerate(zip(*cut, strict=True))
        ]
    return [
        RowMap(parts["nodes"][k], parts["directors"][k], arrays["pieces"][k]) for k in range(count)
    ]
