"""The kinds of a region: one, or several that mix by shares and maps."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from featherfx.groom.kind_store import KindChoice, KindStore
from featherfx.groom.library import sourced
from featherfx.groom.region_rules import Rule, presence
from featherfx.groom.scatter import uniform
from featherfx.groom.schema import Place
from featherfx.groom.surface_points import Array, Indices, SkinSurface, SurfacePoints
from featherfx.groom.types import FeatherKind

_STREAM = 24  # of the draws of kinds


@dataclass(frozen=True)
class RegionKinds:
    """K kinds of a region. choices, kinds: (K). shares: K rules, how much of each there is."""

    choices: tuple[KindChoice, ...]
    kinds: tuple[FeatherKind, ...]
    shares: tuple[Rule, ...]

    @property
    def lengths(self) -> Array:
        """(K,) m."""
        return np.array([kind.length for kind in self.kinds])

    @property
    def cambers(self) -> Array:
        """(K,) deg, of the shafts."""
        return np.array([kind.rachis.camber for kind in self.kinds])

    @property
    def barb_cambers(self) -> Array:
        """(K,) deg, means of the guides of both vanes."""
        return np.array(
            [
                np.mean([guide.camber for guide in kind.leading.guides + kind.trailing.guides])
                for kind in self.kinds
            ]
        )

    def weights(self, points: SurfacePoints) -> Array:
        """(N, K) probabilities of the kinds at places; the first kind where there is none."""
        raw = np.stack([share(points) for share in self.shares], axis=1)
        raw[~(raw > 0.0).any(axis=1), 0] = 1.0
        return raw / raw.sum(axis=1, keepdims=True)

    def drawn(self, points: SurfacePoints, seed: int, numbers: Indices) -> Indices:
        """(N,) kinds of feathers with numbers (N,), each by its own draw."""
        if len(self.kinds) == 1:
            return np.zeros(len(points), dtype=np.int64)
        bounds = np.cumsum(self.weights(points), axis=1)[:, :-1]
        draw = uniform(seed, _STREAM, numbers)
        return np.asarray((draw[:, None] >= bounds).sum(axis=1))


def region_kinds(
    entry: dict[str, Any], place: Place, surface: SkinSurface, folder: Path, store: KindStore
) -> RegionKinds | None:
    """The kinds of a region with checked keys; None after adding problems."""
    count = len(place.problems)
    changes: tuple[int, ...] = ()
    if entry["overrides"]:
        at = place.child("overrides")
        changes = (store.change(sourced(entry["overrides"], place.source), at),)
    given = entry["kind"]
    single = not isinstance(given, tuple)
    entries = [_as_table(each) for each in ((given,) if single else given)]
    choices, kinds, shares = [], [], []
    for number, each in enumerate(entries):
        at = place.child("kind") if single else place.child("kind").item(number)
        choice = KindChoice((each["name"],), 0.0, changes, place if single else at)
        kind = store.kind(choice)
        map_of = presence(each["where"], surface, folder, at.child("where"))
        if kind is not None and map_of is not None:
            choices.append(choice)
            kinds.append(kind)
            shares.append(_scaled(map_of, each["share"]))
    if len(place.problems) > count:
        return None
    if not any(each["share"] > 0.0 for each in entries):
        place.child("kind").fail("has no share above 0")
        return None
    return RegionKinds(tuple(choices), tuple(kinds), tuple(shares))


def _as_table(given: str | dict[str, Any]) -> dict[str, Any]:
    """A kind as a table with all its keys."""
    if isinstance(given, dict):
        return given
    return {"name": given, "share": 1.0, "where": ()}


def _scaled(rule: Rule, share: float) -> Rule:
    return lambda points: share * rule(points)
