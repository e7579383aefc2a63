"""A flock: groups of birds that share a shot, each bird on its own path.

A bird is drawn in one of three ways, by its size in the picture:

    near      simulated along its path, in a cache of its own
    middle    a replay: one bake of the bird on the spot, in the wind of its flight, repeats
    far       a replay of rigid feathers on a coarser grid, in one mesh
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, NamedTuple

from featherfx.algebra.types import Array
from featherfx.groom.keys.preset import PRESET_FAMILIES, Wind
from featherfx.groom.keys.values import (
    ArrayOf,
    Key,
    Number,
    Table,
    Text,
    keys_of,
    tables,
    vector,
)
from featherfx.limits import MAX_BIRDS
from featherfx.shot.clock import MAX_RATE, MIN_RATE
from featherfx.shot.flock.paths import BirdPath
from featherfx.shot.types import Shot

NEAR_BIRD, MIDDLE_BIRD, FAR_BIRD = "near", "middle", "far"
WAYS = (NEAR_BIRD, MIDDLE_BIRD, FAR_BIRD)

_KEYFRAME = ArrayOf(Number(-1e6, 1e6), 4, 4)
_PIXELS = Number(0, 1e6)


@dataclass(frozen=True, kw_only=True)
class BirdGroup:
    """Birds of one shot that fly together. path: (s, m, m, m) of each of its places."""

    shot: Annotated[
        str,
        Text(),
        "Shot of one bird that stays on its place, as seen from this file's folder. Its `cycle` "
        "frames are replayed, or all of its frames; its wind is that of this file.",
    ]
    birds: Annotated[int, Number(1, MAX_BIRDS, whole=True), "Number of birds, along a path."] = 1
    path: Annotated[
        tuple[tuple[float, ...], ...] | None,
        ArrayOf(_KEYFRAME, 2, 10_000),
        "[time in s, x, y, z in m] of the middle of the group in ascending time: smooth between "
        "them, straight on outside.",
    ] = None
    spread: Annotated[
        tuple[float, float, float],
        vector(0, 1e4, "m"),
        "How far birds stand from the middle at most: ahead, to the side, up. They fill the box "
        "evenly, and fly side by side.",
    ] = (0.0, 0.0, 0.0)
    usd: Annotated[
        str | None,
        Text(),
        "USD file of a PointInstancer instead of a path: a bird at each of its points, by its ids, "
        "turned by its orientations where it has any. Frame N is its time code N.",
    ] = None
    prim: Annotated[str | None, Text(), "Path of the PointInstancer."] = None
    forward: Annotated[
        tuple[float, float, float],
        vector(-1, 1, ""),
        "Direction in the bird's shot in which it looks, level.",
    ] = (1.0, 0.0, 0.0)
    gusts: Annotated[
        int,
        Number(1, 100, whole=True),
        "Different replays for birds that are not far, each in gusts of its own.",
    ] = 1
    size_variation: Annotated[
        float,
        Number(0, 0.3),
        "Standard deviation of the size from bird to bird, a share; birds that are near keep "
        "theirs.",
    ] = 0.0
    seed: Annotated[
        int, Number(0, 2**31 - 1, whole=True), "Seed of places, phases, sizes and gusts."
    ] = 1


@dataclass(frozen=True, kw_only=True)
class SeenFrom:
    """Sizes in a picture by which birds are near or far."""

    usd: Annotated[str, Text(), "USD file of the camera, as seen from this file's folder."]
    prim: Annotated[str, Text(), "Path of the camera."]
    image_height: Annotated[float, Number(1, 100_000), "Height of the image in pixels."] = 1080.0
    near_above: Annotated[
        float, _PIXELS, "Birds that are larger than this in any frame are near, in pixels."
    ] = 400.0
    far_below: Annotated[
        float, _PIXELS, "Birds that are smaller than this in all frames are far, in pixels."
    ] = 100.0


FLOCK_KEYS = {
    "name": Key(Text(), "Name of the shot."),
    "frames": Key(
        ArrayOf(Number(-1_000_000, 1_000_000, whole=True), 2, 2),
        "First and last frame, both baked.",
    ),
    "frames_per_second": Key(
        Number(MIN_RATE, MAX_RATE, "1/s"), "Frames per second, those of its birds' shots.", 24.0
    ),
    "wind": Key(PRESET_FAMILIES["wind"], "Wind that the flock flies in, as of a shot.", "calm"),
    "camera": Key(
        Table(keys_of(SeenFrom)), "What decides which birds are near; without it none is.", None
    ),
    "flock": tables(keys_of(BirdGroup), "Groups of birds."),
}
FLOCK_FILE = Table(FLOCK_KEYS, "flock")


_WARM_UP = 12  # frames before a loop, by which its feathers forget how they began


class Loop(NamedTuple):
    """Frames of a bird's shot that repeat: the first, and how many."""

    first: int
    frames: int

    @classmethod
    def of(cls, shot: Shot) -> Loop:
        """Return the loop of a bird's shot: whole cycles after its start, or all of its frames."""
        if not shot.cycle:
            return cls(shot.first_frame, max(shot.last_frame - shot.first_frame, 1))
        return cls(shot.first_frame + shot.cycle * -(-_WARM_UP // shot.cycle), shot.cycle)


@dataclass(frozen=True)
class Bird:
    """One bird. name: unique, fit for a prim. group: number of its group. phase: frames by which it
    is ahead in its loop. size: factor. gust: number of its replay. way: of WAYS. pixels: largest
    size in the picture; 0 without a camera."""

    name: str
    group: int
    path: BirdPath
    phase: int
    size: float
    gust: int
    way: str = MIDDLE_BIRD
    pixels: float = 0.0


@dataclass(frozen=True)
class GroupOfFlock:
    """A group with its bird's shot. span: m, across the bird. middle: (3,) m, of its roots."""

    keys: BirdGroup
    shot: Shot
    loop: Loop
    span: float
    middle: Array


@dataclass(frozen=True)
class FlockShot:
    """A flock as its file has it."""

    name: str
    source: Path
    frames: tuple[int, int]
    frames_per_second: float
    wind: Wind
    groups: tuple[GroupOfFlock, ...]
    birds: tuple[Bird, ...]
