"""Shapes of eight birds, by eye: distances to parts of a body, and where its landmarks are.

Lofts, ellipsoids and tapered capsules in metres at the pigeon's size, x forward, y to the left, z
up. make_body.py turns them into a mesh.
"""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline

HOOK_STEPS = 6
ROUNDING = 0.012  # m, radius over which parts pass into each other


class Colours(NamedTuple):
    """Linear, by eye. down: of what shows between feathers. cere: of the root of the bill."""

    down: tuple[float, float, float] = (0.16, 0.18, 0.22)
    bill: tuple[float, float, float] = (0.05, 0.05, 0.06)
    cere: tuple[float, float, float] = (0.55, 0.52, 0.50)
    leg: tuple[float, float, float] = (0.42, 0.12, 0.10)
    iris: tuple[float, float, float] = (0.75, 0.16, 0.02)


class Legs(NamedTuple):
    """heel, sole: heights, m. thick: radius, m. toes: of the pigeon's length. claws: m, beyond
    their ends. webbed: whether skin spans three of them. down: whether feathers go on below the
    heel, to the toes."""

    heel: float = 0.083
    sole: float = 0.043
    thick: float = 0.0046
    toes: float = 1.0
    claws: float = 0.009
    webbed: bool = False
    down: bool = False

    @property
    def bare(self) -> float:
        """Height, m, below which no feathers are."""
        return self.sole + 0.011 if self.down else self.heel + 0.004


class Build(NamedTuple):
    """A bird at the pigeon's size, by eye.

    size: of all of it. trunk: factors of its length, breadth and depth. neck: (forward, up) m, ways
    of its curve from where it begins to the middle of the skull. slim: m, its radii there, the
    second for a head as large as the pigeon's. head: factor of its radii, beak: of its length,
    thickness, and how far it points down. eye: radius, m, of a head as large as the pigeon's, and
    how far it looks forward, 0 to 1. bare: radii of the eye, between which feathers begin. lean:
    deg, how far it stands up more. rump: (forward, up) m, where it ends, before roots of coverts.
    shoulder: forward and up, m, where wings leave the trunk. hook: deg, that the upper bill turns
    down, over a lower one.
    """

    size: float
    trunk: tuple[float, float, float] = (1.0, 1.0, 1.0)
    neck: tuple[tuple[float, float], ...] = ((0.057, 0.085),)
    slim: tuple[float, float] = (0.036, 0.0215)
    head: float = 1.0
    beak: tuple[float, float, float] = (1.0, 1.0, 1.0)
    eye: tuple[float, float] = (0.0042, 0.2)
    colours: Colours = Colours()
    bare: tuple[float, float] = (1.5, 2.1)
    lean: float = 0.0
    rump: tuple[float, float] = (-0.13, 0.131)
    legs: Legs = Legs()
    shoulder: tuple[float, float] = (0.04, 0.205)
    hook: float = 0.0


_YELLOW, _HORN = (0.65, 0.38, 0.03), (0.12, 0.09, 0.06)
_GULL = Colours((0.86, 0.86, 0.85), _YELLOW, _YELLOW, (0.55, 0.30, 0.25), (0.70, 0.60, 0.25))
_OWL = Colours((0.62, 0.56, 0.48), _HORN, _HORN, (0.35, 0.28, 0.18), (0.020, 0.012, 0.008))
_SPARROW = Colours((0.24, 0.19, 0.14), _HORN, _HORN, (0.40, 0.24, 0.16), (0.03, 0.02, 0.01))
_PARROT = Colours((0.06, 0.13, 0.04), (0.10, 0.09, 0.09), (0.5, 0.46, 0.4), _HORN, (0.6, 0.3, 0.04))
_PEACOCK = Colours((0.04, 0.10, 0.16), _HORN, _HORN, (0.30, 0.26, 0.20), (0.10, 0.05, 0.02))
_SWAN = Colours((0.80, 0.79, 0.77), (0.62, 0.20, 0.03), (0.02, 0.02, 0.02), (0.03, 0.03, 0.03))
_OSTRICH = Colours((0.20, 0.15, 0.13), (0.42, 0.30, 0.22), (0.42, 0.30, 0.22), (0.42, 0.30, 0.24))
_DARK = (0.03, 0.02, 0.01)
_S_NECK = (0.035, 0.02), (0.034, 0.075), (0.004, 0.14), (0.012, 0.2), (0.05, 0.215)
BUILDS = {
    "pigeon": Build(1.0),
    "gull": Build(
        1.3,
        (1.08, 1.15, 0.97),
        ((0.05, 0.073),),
        head=1.1,
        beak=(1.4, 1.3, 0.3),
        eye=(0.0042, 0.2),
        colours=_GULL,
        lean=-10.0,
        rump=(-0.118, 0.1355),
        legs=Legs(thick=0.0042, toes=1.05, webbed=True),
        shoulder=(0.045, 0.207),
        hook=35.0,
    ),
    "owl": Build(
        0.95,
        (0.9, 1.25, 1.12),
        ((0.0285, 0.0425),),
        head=1.5,
        beak=(0.5, 0.9, 2.6),
        eye=(0.0046, 0.7),
        colours=_OWL,
        bare=(0.95, 1.25),
        lean=25.0,
        rump=(-0.118, 0.135),
        legs=Legs(0.082, 0.048, 0.0062, 0.8, 0.014, down=True),
    ),
    "sparrow": Build(
        0.36,
        (0.9, 1.12, 1.1),
        ((0.034, 0.05),),
        head=1.08,
        beak=(0.8, 1.25, 1.0),
        eye=(0.0042, 0.2),
        colours=_SPARROW,
        legs=Legs(thick=0.0045),
    ),
    "parrot": Build(
        0.95,
        (0.95, 1.0, 1.0),
        ((0.035, 0.055),),
        head=1.25,
        beak=(0.85, 1.5, 0.0),
        eye=(0.0044, 0.2),
        colours=_PARROT,
        bare=(1.3, 1.8),
        lean=22.0,
        rump=(-0.118, 0.1345),
        legs=Legs(0.085, 0.055, 0.006, 0.9),
        hook=100.0,
    ),
    "peacock": Build(
        2.3,
        (1.1, 0.95, 0.95),
        ((0.03, 0.05), (0.04, 0.11), (0.066, 0.15)),
        (0.034, 0.0193),
        0.75,
        colours=_PEACOCK,
        legs=Legs(0.07, 0.0),
    ),
    "swan": Build(
        2.6,
        (1.15, 1.15, 1.0),
        _S_NECK,
        (0.027, 0.0185),
        0.75,
        (1.7, 1.5, 1.3),
        (0.0036, 0.2),
        _SWAN._replace(iris=_DARK),
        rump=(-0.108, 0.139),
        legs=Legs(0.1, 0.068, 0.006, 1.0, webbed=True),
    ),
    "ostrich": Build(
        4.2,
        (1.0, 1.1, 1.05),
        ((0.04, 0.03), (0.05, 0.12), (0.055, 0.21), (0.08, 0.24)),
        (0.024, 0.0173),
        0.55,
        (1.1, 1.6, 0.6),
        (0.0056, 0.2),
        _OSTRICH._replace(iris=_DARK),
        legs=Legs(0.005, -0.09, 0.0085, 1.0),
    ),
}
BUILDS["owl_flying"] = BUILDS["owl"]._replace(  # stretched out, its legs drawn up
    neck=((0.045, 0.012),),
    lean=-14.0,
    rump=(-0.112, 0.138),
    legs=BUILDS["owl"].legs._replace(heel=0.104, sole=0.088, toes=0.6),
)
BUILDS["swan_flying"] = BUILDS["swan"]._replace(  # likewise; its neck is as long as in the S
    neck=((0.09, 0.008), (0.18, 0.018), (0.268, 0.02)),
    legs=BUILDS["swan"].legs._replace(heel=0.11, sole=0.092, toes=0.8),
)
NECK = np.array((0.06, 0.0, 0.2))  # where it begins
# m, along the trunk of the pigeon from its rear to its breast, by eye: the middle's place forward
# and up, half the depth across it, and half the breadth. Broad before the folded wings, slimmer
# where they lie; the lower outline is one curve from the vent over the keel into the breast.
TRUNK = np.array(
    (
        (-0.098, 0.1450, 0.020, 0.020),
        (-0.070, 0.1545, 0.0395, 0.033),
        (-0.040, 0.1630, 0.051, 0.038),
        (-0.010, 0.1680, 0.056, 0.040),
        (0.020, 0.1720, 0.056, 0.044),
        (0.045, 0.1755, 0.053, 0.049),
        (0.060, 0.1815, 0.045, 0.047),
    )
)
MIDDLE = 0.033  # m forward, from which trunks are longer or shorter
HIP = np.array((0.0, 0.0, 0.135))  # about which trunks lean


def tilted(ways, pitch):
    """Ways (..., 3), nose up by pitch (deg)."""
    cos, sin = np.cos(np.radians(pitch)), np.sin(np.radians(pitch))
    return ways @ np.array(((cos, 0, sin), (0, 1, 0), (-sin, 0, cos)))


def ellipsoid(points, centre, radii, pitch):
    """About the distance to an ellipsoid, nose up by pitch (deg)."""
    local = tilted(points - centre, -pitch)
    scaled, steeper = local / radii, local / radii**2
    size = np.linalg.norm(scaled, axis=-1)
    return size * (size - 1.0) / np.maximum(np.linalg.norm(steeper, axis=-1), 1e-9)


def capsule(points, start, end, first, last):
    """About the distance to a capsule whose radius goes from first to last."""
    start, along = np.array(start), np.array(end) - np.array(start)
    share = np.clip((points - start) @ along / (along @ along), 0.0, 1.0)
    gap = np.linalg.norm(points - start - share[..., None] * along, axis=-1)
    return gap - (first + (last - first) * share)


def loft(points, stations):
    """About the distance to ellipses whose middles go through stations (S, 4) of TRUNK, m."""
    y, flat = points[..., 1], points[..., [0, 2]]
    found = np.inf
    for start, end in pairwise(stations):
        along = end[:2] - start[:2]
        share = np.clip((flat - start[:2]) @ along / (along @ along), 0.0, 1.0)[..., None]
        x, z, deep, broad = np.moveaxis(start + share * (end - start), -1, 0)
        away = np.hypot(flat[..., 0] - x, flat[..., 1] - z)
        size, steeper = np.hypot(away / deep, y / broad), np.hypot(away / deep**2, y / broad**2)
        found = np.minimum(found, size * (size - 1.0) / np.maximum(steeper, 1e-9))
    return found


def trunk(build):
    """(25, 4) stations of a bird's trunk, upright, m."""
    long, broad, deep = build.trunk
    places = np.linspace(0.0, len(TRUNK) - 1.0, 25)
    x, z, half, side = CubicSpline(np.arange(len(TRUNK)), TRUNK)(places).T
    return np.stack([MIDDLE + long * (x - MIDDLE), z, deep * half, broad * side], axis=1)


def leant(build, points, sense=1.0):
    """Places of the pigeon's trunk (..., 3) as the bird stands, nose up; back with sense -1."""
    return HIP + tilted(np.array(points) - HIP, sense * build.lean)


def neck(build):
    """(13, 3) m, the middle of the neck, from where it begins to the middle of the skull."""
    ways = np.array(((0.0, 0.0), *build.neck))
    long = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(ways, axis=0), axis=1)))
    x, z = CubicSpline(long, ways, bc_type="natural")(np.linspace(0.0, long[-1], 13)).T
    return leant(build, NECK + np.stack([x, np.zeros(13), z], axis=1))


def skull_of(build):
    """(3,) m, its middle."""
    return neck(build)[-1]


def toes(build):
    """Middle of the left foot, (3,) m, and the ends of its toes, (T, 3) m; the hind one is last."""
    own = build.legs
    sole = np.array((0.0, 0.03 * build.trunk[1], own.sole + 0.006))
    low = np.array((0.0, 0.0, 0.002))
    ways = np.array(((0.033, 0.006, 0.0), (0.027, -0.016, 0.0), (-0.02, 0.0, 0.0)))
    ends = sole - low + own.toes * ways
    if own.webbed:
        outer = sole - low + 0.8 * own.toes * np.array((0.024, 0.024, 0.0))
        ends = np.concatenate([outer[None], ends])
    return sole, ends


def bones(build):
    """(start, end, radius there and here) of the left leg's capsules, m."""
    own, wide = build.legs, build.trunk[1]
    knee = np.array((0.0, 0.028 * wide, own.heel + 0.02))
    heel = np.array((-0.012, 0.029 * wide, own.heel))
    sole, ends = toes(build)
    yield (0.005, 0.026 * wide, 0.122), knee, 0.021, 1.7 * own.thick
    yield knee, heel, 1.1 * own.thick, 1.1 * own.thick
    yield heel, sole, 1.1 * own.thick, own.thick
    for toe in ends[-3:]:
        yield sole, toe, own.thick, 0.95 * own.thick
    if own.webbed:
        yield sole, ends[0], own.thick, 0.95 * own.thick
        for first, second in ((ends[0], ends[1]), (ends[1], ends[2])):
            for share in (0.25, 0.5, 0.75):
                web = first + share * (second - first)
                yield sole, sole + 0.85 * (web - sole), 0.8 * own.thick, 0.6 * own.thick


def parts(points, build=BUILDS["pigeon"]):
    """About the distance (m) to each part, negative inside, at the pigeon's size.

    points: (..., 3) m.
    """
    x, y, z = np.moveaxis(points, -1, 0)
    right = np.stack([x, np.abs(y), z], axis=-1)  # both sides at once, on the left
    upright, rump = leant(build, points, -1.0), build.rump
    path = neck(build)
    thick = np.linspace(build.slim[0], 0.95 * build.slim[1] * build.head, len(path))
    necks = zip(path, path[1:], thick, thick[1:], strict=False)
    skull = (0.0265, 0.0205, 0.0215) * np.full(3, build.head)
    return {
        "torso": loft(upright, trunk(build)),
        "neck": np.min([capsule(points, *each) for each in necks], axis=0),
        "head": ellipsoid(points, skull_of(build), skull, -8),
        "beak": np.min([capsule(points, *each) for each in horns(build)], axis=0),
        "rump": capsule(upright, (-0.06, 0, 0.157), (rump[0], 0, rump[1]), 0.034, 0.011),
        "leg": np.min([capsule(right, *each) for each in bones(build)], axis=0),
    }


def bill(build):
    """(K, 3) m, along the middle of the upper bill, from its root to its tip."""
    root = skull_of(build) + build.head * np.array((0.018, 0.0, -0.002))
    way = build.beak[0] * np.array((0.031, 0.0, -0.011 * build.beak[2]))
    if not build.hook:
        return np.stack([root, root + way])
    turns = np.radians(build.hook) * (np.arange(HOOK_STEPS) + 0.5) / HOOK_STEPS
    ahead = np.cos(turns) * way[0] + np.sin(turns) * way[2]
    up = np.cos(turns) * way[2] - np.sin(turns) * way[0]
    steps = np.stack([ahead, np.zeros(HOOK_STEPS), up], axis=1) / HOOK_STEPS
    return root + np.vstack([np.zeros(3), np.cumsum(steps, axis=0)])


def beak(build):
    """Its root and tip, (3,) m."""
    path = bill(build)
    return path[0], path[-1]


def horns(build):
    """(start, end, radius there and here) of the bill's capsules, m."""
    path, thick = bill(build), build.beak[1]
    radii = thick * np.linspace(0.0075, 0.0015 if build.hook else 0.0035, len(path))
    yield from zip(path, path[1:], radii, radii[1:], strict=False)
    if build.hook:
        below = path[0] - (0.0, 0.0, 0.006 * thick)
        tip = path[len(path) // 2] - (0.0, 0.0, 0.006 * thick)
        yield below, tip, 0.0045 * thick, 0.0025 * thick


def eye(build):
    """Middle of the left eye, (3,) m, and the unit way that it looks, at the pigeon's size."""
    radius, forward = build.eye
    look = np.array((forward, 1.0 - forward, 0.08))
    look /= np.linalg.norm(look)
    skull = skull_of(build)
    radii = build.head * np.array((0.0265, 0.0205, 0.0215))
    aim = np.array((0.42 + 0.45 * forward, 1.0 - 0.55 * forward, 0.2))
    rim = skull + radii * aim / np.linalg.norm(aim)
    deep = 0.15 + 0.8 * max(forward - 0.2, 0.0)  # those that look forward lie in a disc
    return rim - deep * build.head * radius * look, look


def landmarks(build):
    """Those of a groom's [bird], (3,) m by name, at the bird's size."""
    skull, (_, wide, deep) = skull_of(build), build.trunk
    (ahead, up), (middle, _) = build.shoulder, eye(build)
    front = trunk(build)[-1]
    found = {
        "beak": beak(build)[1],
        "crown": skull + build.head * np.array((0.001, 0, 0.022)),
        "nape": skull + build.head * np.array((-0.023, 0, 0.005)),
        "breast": leant(build, (front[0] + front[2], 0, 0.185)),
        "right_shoulder": leant(build, (ahead, -0.042 * wide, up)),
        "left_shoulder": leant(build, (ahead, 0.042 * wide, up)),
        "vent": leant(build, (-0.075, 0, 0.168 - 0.053 * deep)),
        "tail": leant(build, (-0.134, 0, 0.138)),
        "right_heel": np.array((-0.008, -0.0285 * wide, build.legs.bare + 0.005)),
        "left_heel": np.array((-0.008, 0.0285 * wide, build.legs.bare + 0.005)),
        "right_eye": middle * (1.0, -1.0, 1.0),
        "left_eye": middle,
    }
    return {name: build.size * place for name, place in found.items()}


def union(*values):
    """Smooth, by an exponential minimum."""
    least, width = np.min(values, axis=0), ROUNDING / 3.0
    return least - width * np.log(np.exp(-(np.array(values) - least) / width).sum(axis=0))


def distance(points, build=BUILDS["pigeon"]):
    return union(*parts(points, build).values())


def smooth(value, low, high):
    share = np.clip((value - low) / (high - low), 0.0, 1.0)
    return share * share * (3.0 - 2.0 * share)
