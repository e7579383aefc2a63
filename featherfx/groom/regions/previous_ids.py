"""Ids of a region's feathers from an earlier publish, by the places of their roots.

Pairs of a root and an earlier one within a spacing of the latter are taken in the order of their
distance, each root once. A feather without a pair keeps its own id unless an earlier one has it.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from featherfx.algebra.types import Array, Indices
from featherfx.groom.keys.groom import USD_KEYS
from featherfx.groom.keys.problems import Place, nearest
from featherfx.groom.read.readers import DrawnFeather, SceneReader
from featherfx.groom.regions.scatter import Scattered, hashed
from featherfx.groom.skin.field import search_tree
from featherfx.provenance import LeftOut, StageRead, note_read

_MAX_CANDIDATES = 8  # earlier roots near one that are looked at
# ids that a warning names
_MAX_NAMED = 5
_NUMBER = re.compile(r"_([0-9a-f]{10})$")


def read_previous(
    entry: dict[str, Any], folder: Path, place: Place, read: SceneReader
) -> list[DrawnFeather]:
    """Return a region's feathers in the file that its key ids_from names, none without the key.

    place: of the region. Raises InputError, also where the file holds no feather of the region.
    """
    if entry["ids_from"] is None:
        return []
    keys = {name: key.default for name, key in USD_KEYS.items()} | {"file": entry["ids_from"]}
    at = place.child("ids_from")
    path, feathers = read(keys, folder, at)
    own = [each for each in feathers if each.region == entry["id"] and each.id]
    if not own:
        known = nearest(entry["id"], {each.region for each in feathers} - {""})
        at.refuse(f"{path} holds no feather of region '{entry['id']}', {known}")
    return own


def take_ids(
    entry: dict[str, Any], fresh: Scattered, previous: Sequence[DrawnFeather], names: Sequence[str]
) -> tuple[Scattered, list[str]]:
    """Return the points of a region with the numbers of earlier feathers at their places, and ids.

    A number is what a feather's variation is drawn by. entry: checked keys of the region. names:
    ids by the points' own numbers.
    """
    pairs = _pair_roots(fresh.points.position, np.stack([each.points[0] for each in previous]))
    earlier = [each.id for each in previous]
    free = set(earlier) - {earlier[k] for k in pairs.values()}
    known, ids, numbers, new = set(earlier), [], fresh.number.copy(), []
    for k, name in enumerate(names):
        if k in pairs:
            name = earlier[pairs[k]]
        elif name in free:  # the same candidate, which the surface has carried away
            free.remove(name)
        else:
            while name in known:
                words: Indices = np.array([numbers[k]], dtype=np.int64)
                numbers[k] = int(hashed(0, 6, words)[0] >> np.uint64(24))
                name = f"{entry['id']}_{numbers[k]:010x}"
            new.append(name)
            known.add(name)
        ids.append(name)
        if found := _NUMBER.search(name):
            numbers[k] = int(found[1], 16)
    _note(entry, len(ids) - len(new), new, sorted(free))
    return Scattered(fresh.points, numbers), ids


def _pair_roots(roots: Array, earlier: Array) -> dict[int, int]:
    """Return the number of the earlier root (M, 3) for those of the roots (N, 3) that have one."""
    tree = search_tree(earlier)
    apart = tree.query(earlier, k=2)[0][:, 1]
    reach = float(np.median(apart[np.isfinite(apart)])) if len(earlier) > 1 else np.inf
    distance, near = tree.query(roots, k=min(_MAX_CANDIDATES, len(earlier)))
    distance, near = distance.reshape(len(roots), -1), near.reshape(len(roots), -1)
    pairs: dict[int, int] = {}
    taken: set[int] = set()
    for place in np.argsort(distance, axis=None, kind="stable"):
        k, j = divmod(int(place), distance.shape[1])
        other = int(near[k, j])
        if distance[k, j] > reach:
            break
        if k not in pairs and other not in taken:
            pairs[k] = other
            taken.add(other)
    return pairs


def _note(entry: dict[str, Any], count: int, new: Sequence[str], gone: Sequence[str]) -> None:
    """Tell how many ids stay, which feathers are new and which are gone."""
    more = ", ..." if len(new) > _MAX_NAMED else ""
    named = f" ({', '.join(new[:_MAX_NAMED])}{more})" if new else ""
    left = tuple(LeftOut(name, "earlier ids", "no feather has") for name in gone)
    fresh = f"{len(new)} new{named}"
    path = f"region '{entry['id']}'"
    note_read(StageRead(entry["ids_from"], path, "kept id", count, left, lambda: fresh))
