"""What a bake takes over of an earlier one with other settings: feathers that nothing touched."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from featherfx.usd.read.earlier import EarlierCache
from featherfx.usd.write.resume import difference

# settings that need not be equal: frames are looked at, the others are in what feathers depend on
_FREE = ("frames", "feathers", "textures")


@dataclass(frozen=True)
class TakenOver:
    """Of an earlier cache at a bake's output.

    cache: the earlier one. feathers: numbers among the bake's of those whose samples are taken.
    changed: what is different, in words.
    """

    cache: EarlierCache
    feathers: tuple[int, ...]
    changed: tuple[str, ...]


def taken_over(
    path: Path,
    settings: Mapping[str, str],
    inputs: Mapping[str, str],
    names: Sequence[str],
    dependences: Sequence[str],
) -> TakenOver | None:
    """What a bake may take of a finished cache at its output; None where that is nothing.

    names: of its prims, and dependences: of its feathers.
    """
    if not path.is_file():
        return None
    earlier = EarlierCache(path)
    if not _fits(earlier.settings, settings):
        return None
    same = tuple(
        k
        for k, (name, each) in enumerate(zip(names, dependences, strict=True))
        if earlier.dependences.get(name) == each
    )
    if not same:
        return None
    told = difference(earlier.settings, earlier.inputs, settings, inputs)
    return TakenOver(earlier, same, tuple(f"{key}: {change}" for key, change in told.items()))


def _fits(earlier: Mapping[str, str], settings: Mapping[str, str]) -> bool:
    """Whether samples are written alike, from the same first frame to a last that is there."""
    alike = all(
        earlier.get(key) == text
        for key, text in settings.items()
        if key not in _FREE and not key.startswith("shot.")
    )
    before, now = (_frames(each.get("frames", "")) for each in (earlier, settings))
    return alike and before[0] == now[0] and now[1] <= before[1]


def _frames(text: str) -> tuple[int, int]:
    """First and last of "A-B"; none where it is not that."""
    found = re.fullmatch(r"(-?\d+)-(-?\d+)", text)
    return (int(found[1]), int(found[2])) if found else (1, 0)
