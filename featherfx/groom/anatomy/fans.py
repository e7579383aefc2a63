"""[[tail]] and [[crest]]: feathers that open and close about one joint, each by its share.

Limbs of all sorts, wings included, are grown together: their feathers and joints.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from featherfx.algebra.types import Array
from featherfx.algebra.vectors import (
    about_x,
    frames_from,
    from_rotation_vector,
    motions,
    parallel,
    screws_of,
)
from featherfx.groom.anatomy.remiges import spread_evenly
from featherfx.groom.anatomy.wing import wing
from featherfx.groom.course import Mirror, along_polyline
from featherfx.groom.keys.problems import Place
from featherfx.groom.presets.library import Library
from featherfx.groom.presets.presets import KindChoice, KindStore
from featherfx.groom.read.drafts import Draft, mirror_of, other_side, with_mirror_images
from featherfx.groom.read.space import Space
from featherfx.groom.types import FeatherKind, Joint, Turning


def tail(entry: dict[str, Any], place: Place, store: KindStore) -> tuple[list[Draft], list[Joint]]:
    """The drafts of one [[tail]] and its joints. Raises InputError.

    Pairs count from the middle, where they lie uppermost; the right feather of a pair over the
    left one. A feather stands at its share of half the width of the root and of half the fan.
    """
    if parallel(entry["direction"], entry["up"]):
        place.child("up").refuse("is parallel to direction. Turn one of them: give another vector")
    if entry["count"] % 2:
        place.child("count").refuse(f"{entry['count']} is odd, a tail has pairs of feathers")
    frame = frames_from(entry["direction"], entry["up"])
    base = np.array(entry["position"])
    closed, opened = (0.5 * np.radians(angle) for angle in entry["angles"])
    joints = [Joint(entry["id"], base, entry["joint"])]
    for sign, side in _SIDES:
        # right of a tail that points backwards is y of its frame
        hinge = sign * (closed - opened) * frame[:, 2]
        bone = f"{entry['id']}_{side}"
        joints.append(Joint(bone, base, entry["id"], "body", 0, hinge, 1.0 - entry["fan"]))
    row = _TailRow(
        kind=entry["kind"],
        width=entry["width"],
        region=entry["region"],
        name=f"{entry['id']}_{{}}_",
        lift=entry["lift"],
    )
    drafts = _tail_row(entry, place, store, frame, row)
    for covert in _tail_coverts(entry):
        drafts += _tail_row(entry, place, store, frame, covert)
    return drafts, joints


_SIDES = ((1.0, "right"), (-1.0, "left"))
TAIL_THINNING = 0.6  # lift of coverts beside that of tail feathers; by eye
_CLEAR = 0.01  # of the tail's length, from a covert's tip to what it lies on; by eye
_CLOSE = 1.5  # of that, at their roots below a tail, so that these stay out of the rump


class _Plane(NamedTuple):
    """Plane below feathers. height: m, over the root of the tail. slope: m per m, behind it."""

    height: float = 0.0
    slope: float = 0.0

    def above(self, way: Any) -> Any:
        """m, way m behind the root of the tail."""
        return self.height + self.slope * way

    def carries(self, ahead: float, length: float, root: float, tip: float) -> _Plane:
        """That of feathers whose roots, ahead m of the tail's, and tips are so many m over it."""
        slope = self.slope + (tip - root) / length
        return _Plane(self.above(-ahead) + root + slope * ahead, slope)


_FLAT = _Plane()


@dataclass(frozen=True)
class _TailRow:
    """Feathers of a tail that are of one sort. name: of ids, with a place for the side. lift: m,
    as of the tail. covert: one that a layout may move, as the coat.
    length: as of its coverts. ahead: m, likewise. below: whether its dorsal side looks down.
    near, far: of its feathers next to the row before, and of those that lie over all others."""

    kind: str
    width: float
    region: str
    name: str
    lift: float
    length: float = 1.0
    covert: bool = False
    ahead: float = 0.0
    below: bool = False
    near: _Plane = _FLAT
    far: _Plane = _FLAT

    def plane(self, share: float) -> _Plane:
        """share: from the middle of the tail to its outermost feather, which is the lowest."""
        over = share if self.below else 1.0 - share
        pairs = zip(self.near, self.far, strict=True)
        return _Plane(*(a + over * (b - a) for a, b in pairs))


def _tail_coverts(entry: dict[str, Any]) -> list[_TailRow]:
    """Rows from the tail outwards: each lies on the plane of the one before it. Below the feathers
    of a row fill what is between both, so that none stands open at its side."""
    longest, lift = max(entry["lengths"]), TAIL_THINNING * entry["lift"]
    pairs = entry["count"] // 2 - 0.5
    rows = []
    for side in ("above", "below"):
        own = [each for each in entry["coverts"] if each["side"] == side]
        outer = _Plane(0.0 if side == "above" else pairs * entry["lift"])
        for each in own:
            ahead, length = longest * each["ahead"], longest * each["length"]
            clear, thick = longest * _CLEAR, pairs * lift
            gap = longest * max(each["height"], _CLEAR)
            close = min(_CLOSE * clear, gap) if side == "below" else gap
            near = outer.carries(ahead, length, close, clear)
            outer = outer.carries(ahead, length, gap + thick, clear + thick)
            rows.append(
                _TailRow(
                    kind=each["kind"],
                    width=each["width"],
                    region=f"{each['name']}s",
                    name=f"{entry['id']}_{{}}_{each['name']}_",
                    lift=lift,
                    covert=True,
                    length=each["length"],
                    ahead=ahead,
                    below=side == "below",
                    near=near,
                    far=outer,
                )
            )
    return rows


def _tail_row(
    entry: dict[str, Any], place: Place, store: KindStore, frame: Array, row: _TailRow
) -> list[Draft]:
    """A feather for each of the tail's."""
    choice = KindChoice((row.kind,), 0.0, (), place)
    kind = store.kind(choice)
    base, pairs = np.array(entry["position"]), entry["count"] // 2
    closed, opened = (0.5 * np.radians(angle) for angle in entry["angles"])
    half, arch = 0.5 * entry["root_width"], 0.5 * np.radians(entry["arch"])
    bent = 1.0 - entry["fan"]
    lengths = row.length * spread_evenly(entry["lengths"], pairs)
    up = -1.0 if row.below else 1.0
    # coverts reach where a straight shaft would
    rises = 0.5 * np.radians(kind.rachis.camber) if row.covert else 0.0
    drafts: list[Draft] = []
    for sign, side in _SIDES:
        bone = f"{entry['id']}_{side}"
        for number in range(pairs):
            fraction = (number + 0.5) / pairs
            length = float(lengths[number])
            opening = sign * fraction * entry["fan"] * (opened - closed)
            opens = from_rotation_vector(opening * frame[:, 2])
            turned = opens @ from_rotation_vector(sign * fraction * closed * frame[:, 2]) @ frame
            # left feathers under right ones; the coverts below count outwards, too
            order = number + (0.0 if sign > 0.0 else 0.5)
            depth = 0.0 if row.covert else row.lift * order
            anchor = base + sign * fraction * half * frame[:, 1] - depth * frame[:, 2]
            plane = row.plane(order / (pairs - 0.5))
            high = up * plane.above(-row.ahead)
            root = anchor + high * turned[:, 2] - row.ahead * turned[:, 0]
            turning, wrap = Turning((entry["id"], bone), fraction, anchor), 0.0
            pitch = np.array([0.0, -up * (math.atan(plane.slope) + rises), 0.0])
            turned = turned @ from_rotation_vector(pitch) @ about_x(180.0 if row.below else 0.0)
            if arch:  # round an axis along the tail, as if its feathers lay on a cylinder
                bow = from_rotation_vector(-sign * fraction * arch * frame[:, 0])
                above = bow @ ((half / arch - depth) * frame[:, 2])
                shift = base - half / arch * frame[:, 2] + above - bow @ anchor
                away, bow = anchor - opens @ anchor, opens @ bow @ opens.T
                shift = opens @ shift + away - bow @ away
                screw = screws_of(bow[None], shift[None])
                turning = replace(turning, bow=screw[0])
                bow, shift = (each[0] for each in motions(bent * screw))
                root, turned = bow @ root + shift, bow @ turned
                wrap = up * bent * arch * length / (half + 0.5 * length * closed)
            drafts.append(
                Draft(
                    id=f"{row.name.format(side)}{number + 1:02d}",
                    choice=choice,
                    position=root,
                    rotation=turned,
                    region=row.region,
                    joint=entry["id"],
                    left=(sign < 0.0) != row.below,
                    scale=length / kind.length,
                    width=row.width,
                    roll=up * entry["roll"] * fraction,
                    place=place,
                    # all are curved alike, so that they nest
                    curl=kind.rachis.camber * (length / lengths.max() - 1.0),
                    turning=turning,
                    wrap=(wrap, wrap),
                )
            )
    return drafts


def closed_fan(entry: dict[str, Any]) -> Array:
    """(T, 3, 3) m, triangles of the upper side of a [[tail]] that is closed, with its coverts."""
    frame = frames_from(entry["direction"], entry["up"])
    half = 0.5 * np.radians(entry["angles"][0])
    along, aside = np.meshgrid(np.linspace(0.0, 1.0, 7), np.linspace(-1.0, 1.0, 4), indexing="ij")
    way = max(entry["lengths"]) * along
    wide = aside * (0.5 * entry["root_width"] + way * np.tan(half))
    rows = [each for each in _tail_coverts(entry) if not each.below]
    high = np.zeros_like(way)
    for row in rows:  # planes that go on below the tail behind their tips
        high = np.maximum(high, row.far.above(way))
    grid = np.stack([way, wide, high], axis=-1) @ frame.T + entry["position"]
    first, right, left, last = grid[:-1, :-1], grid[:-1, 1:], grid[1:, :-1], grid[1:, 1:]
    pairs = [(first, left, last), (first, last, right)]
    return np.concatenate([np.stack(each, axis=2).reshape(-1, 3, 3) for each in pairs])


def crest(entry: dict[str, Any], place: Place, store: KindStore) -> tuple[list[Draft], list[Joint]]:
    """The drafts of one [[crest]] and its joint. Raises InputError.

    Feathers stand along a path from front to back, by turns left and right of it; those in front
    turn by the whole angle, the last by half of it, and lie over those behind.
    """
    kind = _kind(entry, place, store)
    path = np.array(entry["path"])
    frame = frames_from(entry["direction"], entry["up"])
    count = entry["count"]
    roots = along_polyline(path, np.linspace(0.0, 1.0, count) if count > 1 else np.zeros(1))
    flat, raised = (np.radians(angle) for angle in entry["angles"])
    hinge = (raised - flat) * frame[:, 1]  # raising turns the other way
    name = entry["id"]
    joints = [
        Joint(f"{name}_base", path[-1], entry["joint"]),
        Joint(name, path[-1], f"{name}_base", "body", 0, hinge, 1.0 - entry["raise"]),
    ]
    fractions = np.linspace(1.0, 0.5, count)
    lengths = spread_evenly(entry["lengths"], count)
    drafts = []
    for number, (root, fraction) in enumerate(zip(roots, fractions, strict=True)):
        sign = -1.0 if number % 2 else 1.0
        angle = -fraction * (flat + entry["raise"] * (raised - flat))
        turned = from_rotation_vector(angle * frame[:, 1]) @ frame
        aside = from_rotation_vector(np.radians(sign * entry["aside"]) * turned[:, 2])
        drafts.append(
            _draft(
                entry,
                place,
                kind,
                id=f"{name}_{number + 1:02d}",
                position=root,
                rotation=aside @ turned @ about_x(sign * entry["roll"]),
                scale=float(lengths[number]) / kind.length,
                roll=0.0,
                left=sign < 0.0,
                turning=Turning((f"{name}_base", name), float(fraction), root),
            )
        )
    return drafts, joints


def _kind(entry: dict[str, Any], place: Place, store: KindStore) -> FeatherKind:
    if parallel(entry["direction"], entry["up"]):
        place.child("up").refuse("is parallel to direction. Turn one of them: give another vector")
    return store.kind(KindChoice((entry["kind"],), 0.0, (), place))


def _draft(entry: dict[str, Any], place: Place, kind: FeatherKind, **own: Any) -> Draft:
    longest = max(entry["lengths"])
    length = own["scale"] * kind.length
    return Draft(
        choice=KindChoice((entry["kind"],), 0.0, (), place),
        region=entry["region"],
        joint=own["turning"].joints[0],
        width=entry["width"],
        place=place,
        # all are curved alike, so that they nest
        curl=kind.rachis.camber * (length / longest - 1.0),
        **own,
    )


def grow_limbs(
    parts: dict[str, Any], store: KindStore, library: Library, space: Space
) -> tuple[tuple[Draft, ...], tuple[tuple[Joint, Place], ...]]:
    """Return feathers and joints of [[wing]], [[tail]] and [[crest]], joints with their tables.

    Problems go to the places of the tables.
    """
    drafts: list[Draft] = []
    joints: list[tuple[Joint, Place]] = []
    taken: dict[str, Place] = {}
    for at, entry in reversed(parts["wing"]):  # those of [bird] come last
        if taken.setdefault(entry["id"], at) is not at:
            other = taken[entry["id"]].key
            at.child("id").fail(f"'{entry['id']}' is taken by {other}. Choose another")
    for at, entry in parts["wing"]:
        if taken[entry["id"]] is not at:
            continue
        with at.problems.collecting():
            if parallel(entry["forward"], entry["up"]):
                at.child("up").refuse("is parallel to forward. Give another vector")
            axes = frames_from(entry["forward"], entry["up"])
            own, bones = wing(entry, at, store, library, axes)
            mirror = mirror_of(entry, space)
            drafts += with_mirror_images(own, at, mirror)
            joints += [(each, at) for each in bones]
            if mirror is not None:
                joints += [(_mirrored(each, mirror), at) for each in bones if other_side(each.name)]
    for name, grow in (("tail", tail), ("crest", crest)):
        for at, entry in parts[name]:
            with at.problems.collecting():
                own, bones = grow(entry, at, store)
                drafts += own
                joints += [(each, at) for each in bones]
    return tuple(drafts), tuple(joints)


def _mirrored(joint: Joint, mirror: Mirror) -> Joint:
    hinge = None if joint.hinge is None else mirror.rotation_vectors(joint.hinge)
    return replace(
        joint,
        name=other_side(joint.name) or joint.name,
        position=mirror.points(np.asarray(joint.position)),
        parent=other_side(joint.parent) or joint.parent,
        side=-joint.side,
        hinge=hinge,
        bone=None if joint.bone is None else mirror.points(joint.bone),
        offset=None if joint.offset is None else mirror.directions(joint.offset),
    )
