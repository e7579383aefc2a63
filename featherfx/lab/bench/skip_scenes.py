"""What shots are made into, so that a way of skipping work has something to skip."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from featherfx.shot.detail.view import TimedCamera, View
from featherfx.shot.motion.motion import root_motion
from featherfx.shot.types import LevelOfDetail, Motion, Shot

Array = NDArray[np.float64]

# s, how long feathers are held still or fly straight on
SCENE = 6.0
# of a wing that beats on
BEATS = 8


@dataclass(frozen=True)
class _Dolly:
    """A camera that looks along x at a place and backs away from it evenly, one code a second."""

    target: Array
    near: float
    far: float
    duration: float
    time_codes_per_second: float = 1.0
    origin: tuple[str, tuple[Path, ...]] = ("", ())

    def view(self, code: float) -> View:
        x, y, z = np.eye(3)
        distance = self.near + (self.far - self.near) * code / self.duration
        return View(self.target - distance * x, -y, z, -x, 0.8, 0.45, (0.0, 0.0), False)


def backing_away(shot: Shot) -> Shot:
    """A camera sees the whole plumage, then backs away until feathers are ten pixels long."""
    lengths = np.array([p.kind.length for p in shot.groom.feathers])
    roots, _ = root_motion(shot).frames(0.0)
    size = float(np.linalg.norm(np.ptp(roots, axis=0))) + 2.0 * float(lengths.max())
    far = LevelOfDetail().image_height * float(lengths.mean()) / (10.0 * 0.45)
    duration = (shot.last_frame - shot.first_frame) / shot.frames_per_second
    dolly = _Dolly(roots.mean(axis=0), 2.0 * size, max(far, 2.0 * size), max(duration, 1e-3))
    rules = LevelOfDetail(camera=TimedCamera(dolly, 0.0))
    return replace(undecided(shot), level_of_detail=rules)


def undecided(shot: Shot) -> Shot:
    """Without the levels that the file gives, which overrule a camera's."""
    return replace(shot, details=())


def still(shot: Shot) -> Shot:
    """Nothing moves, in still air, for some seconds."""
    wind = replace(shot.wind, speed=0.0, gust=0.0)
    free = replace(shot, grips=(), forces=(), skin=None, wind_source=None)
    last = shot.first_frame + round(SCENE * shot.frames_per_second)
    return replace(free, motion=Motion("hold", {}), wind=wind, last_frame=last)


def cruising(shot: Shot) -> Shot:
    """The whole groom flies straight on at 10 m/s in vacuum, after a start of a second."""
    held, start = still(shot), 1.0
    times = np.linspace(0.0, SCENE, 121)
    way = np.where(times < start, 5.0 * times**2 / start, 10.0 * (times - 0.5 * start))
    keys = [
        {"time": float(t), "joint": "", "position": (float(x), 0.0, 0.0)}
        for t, x in zip(times, way, strict=True)
    ]
    motion = Motion("keys", {"keyframes": keys})
    return replace(held, motion=motion, wind=replace(held.wind, air_density=0.0))


def beating_on(shot: Shot) -> Shot:
    """Eight beats of a wing that take whole frames each, in steady wind."""
    values = shot.motion.values | {"beats": 0.0, "period": beat(shot) / shot.frames_per_second}
    last = shot.first_frame + BEATS * beat(shot)
    wind = replace(shot.wind, gust=0.0)
    return replace(shot, motion=Motion("flap", values), wind=wind, last_frame=last)


def beat(shot: Shot) -> int:
    """Frames of a wing beat."""
    return max(1, round(float(shot.motion.values["period"]) * shot.frames_per_second))


def beats(shot: Shot) -> bool:
    """Whether a shot is a wing beat that may be replayed."""
    return shot.motion.kind == "flap" and shot.contact is None
