"""The camera of a stage, for pictures of a cache."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from featherfx.groom.keys.values import Place, Problems
from featherfx.shot.detail.view import View
from featherfx.usd.read.read import Cache
from featherfx.usd.read.scenes import open_camera


def camera_of(path: Path, named: str, cache: Cache) -> Callable[[float | None], View]:
    """What a camera sees, by the cache's time codes; None: at rest, which is its first frame.

    path: of the cache. named: prim path in that file, or FILE:PATH of another one. Raises
    InputError with the cameras that there are where it is none of them.
    """
    file, colon, prim = named.rpartition(":/")
    where = Path(file) if colon else path
    problems = Problems()
    camera = open_camera(
        where, f"/{prim}" if colon else named, Place("preview", "camera", problems)
    )
    problems.raise_any()
    assert camera is not None
    rate = camera.time_codes_per_second / cache.frames_per_second

    def seen(time: float | None) -> View:
        return camera.view(0.0 if time is None else rate * time)

    return seen
