"""Rest geometry of placed feathers, on their leaves where a groom has a coat."""

from __future__ import annotations

from collections.abc import Sequence

from featherfx.feather.shapes import build_plane_feathers
from featherfx.feather.types import Feather
from featherfx.groom.types import Placement


def build_feathers(placements: Sequence[Placement], rows: int, columns: int) -> list[Feather]:
    """Build the rest geometry of placed feathers, each in its own frame and on its leaf.

    Feathers without a leaf share theirs by shape and size. rows, columns: as in build_feather.
    Raises InputError with the problems of all shapes that cannot be built.
    """
    built = build_plane_feathers(placements, rows, columns)
    if all(each.leaf is None for each in placements):
        return built
    from featherfx.feather.leaves import lie_on_leaves  # only where a groom has a coat

    return lie_on_leaves(placements, built)
