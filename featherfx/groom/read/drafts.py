"""Feathers as written down: single ones and rows, before overrides, variation and kinds; and their
colours between regions.

A feather that stands where regions overlap has the mean of their bases, films and pigments by how
much of each there is, as it has their mean length; patterns stay those of its own region. A skin
that is painted has the last word on both.
"""

from __future__ import annotations

import fnmatch
import hashlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from featherfx.algebra.types import Array
from featherfx.algebra.vectors import frames_from, from_angles, interpolated, parallel, transported
from featherfx.errors import all_of, warn_input
from featherfx.groom.course import Mirror, along_polyline
from featherfx.groom.keys.problems import Place
from featherfx.groom.materials import PIGMENTS, VANE_COLOUR, displayed
from featherfx.groom.presets.library import sourced
from featherfx.groom.presets.presets import KindChoice, KindStore
from featherfx.groom.read.space import CurveReader, Space
from featherfx.groom.types import Turning

if TYPE_CHECKING:
    from featherfx.groom.read.rachis_curve import FittedCurve


@dataclass(frozen=True)
class DrawnShape:
    """A shaft that was drawn. choice: the kind before overrides, which win over the drawing.

    bent: whether camber and sweep follow the drawing too, not its length alone.
    """

    fit: FittedCurve
    choice: KindChoice
    bent: bool


@dataclass(frozen=True)
class Draft:
    """One feather on its way into a groom.

    position: (3,) m. rotation: (3, 3) before roll. roll: deg, positive lifts the leading vane.
    scale, width, stiffness, weight: factors. place: where it was written, for problems. shape: of
    a drawn feather. skin, skin_uv, grown, turning: as in Placement. curl, hollow:
    deg, added to the camber of the shaft and of the barbs. wrap: of barbs, as in Change. mixture:
    regions between which it stands, and how much there is of each; empty within one. paint: sRGB
    of the skin where it stands; empty where this has no colours.
    """

    id: str
    choice: KindChoice
    position: Array
    rotation: Array
    region: str
    joint: str
    left: bool
    scale: float
    width: float
    roll: float
    place: Place
    shape: DrawnShape | None = None
    skin: str = ""
    skin_uv: tuple[float, float] | None = None
    curl: float = 0.0
    hollow: float = 0.0
    wrap: tuple[float, float] = (0.0, 0.0)
    grown: bool = False
    stiffness: float = 1.0
    weight: float = 1.0
    turning: Turning | None = None
    mixture: tuple[tuple[str, float], ...] = ()
    paint: tuple[float, ...] = ()


def other_side(name: str) -> str | None:
    """The name with "left" and "right" exchanged, None where it holds neither."""
    for word, other in (("left", "right"), ("right", "left")):
        if word in name:
            return name.replace(word, other)
    return None


def with_mirror_images(drafts: list[Draft], place: Place, mirror: Mirror | None) -> list[Draft]:
    """The drafts followed by their mirror images; problems where ids name no side, an InputWarning
    where they name the other one."""
    if mirror is None or not drafts:
        return drafts
    _warn_of_side(drafts[0], place)
    images = []
    for draft in drafts:
        name = other_side(draft.id)
        if name is None:
            place.child("id").fail(f'\'{draft.id}\' must hold "left" or "right" to be mirrored')
            return drafts
        images.append(
            replace(
                draft,
                id=name,
                position=mirror.points(draft.position),
                rotation=mirror.frames(draft.rotation),
                joint=other_side(draft.joint) or draft.joint,
                left=not draft.left,
                turning=_mirrored(draft.turning, mirror),
            )
        )
    return drafts + images


def _warn_of_side(draft: Draft, place: Place) -> None:
    """Feathers of a left wing are those of a right one unless their table says so."""
    side, other = ("left", "right") if "left" in draft.id else ("right", "left")
    if side in draft.id and draft.left != (side == "left"):
        warn_input(
            f"{place.source}: {place.key}: '{draft.id}' is a feather of the {other} side, with its"
            f" leading vane there. Give side = '{side}', or another id",
            3,
        )


def _mirrored(turning: Turning | None, mirror: Mirror) -> Turning | None:
    if turning is None:
        return None
    first, second = (other_side(name) or name for name in turning.joints)
    bow = None if turning.bow is None else mirror.screw(turning.bow)
    return Turning((first, second), turning.fraction, mirror.points(turning.anchor), bow)


def _changes(entry: dict[str, Any], place: Place, store: KindStore) -> tuple[int, ...]:
    if not entry["overrides"]:
        return ()
    at = place.child("overrides")
    return (store.change(sourced(entry["overrides"], place.source), at),)


def _rotation(entry: dict[str, Any], place: Place, space: Space) -> Array:
    direction, up, angles = entry["direction"], entry["up"], entry["rotation"]
    if angles is not None:
        if direction is not None or up is not None:
            place.child("rotation").refuse("stands beside direction or up, expects one of the two")
        return space.axes @ from_angles(angles)
    if direction is None and up is None:
        return space.axes
    if direction is None or up is None:
        missing = "direction" if direction is None else "up"
        place.child(missing).refuse("is missing. Give direction and up together")
    if parallel(direction, up):
        place.child("up").refuse("is parallel to direction. Give another vector")
    return frames_from(direction, up)


def mirror_of(entry: dict[str, Any], space: Space) -> Mirror | None:
    """The plane that a table mirrors at, None where it does not."""
    return space.mirror(entry["mirror"]) if entry["mirror"] else None


def belonging(entry: dict[str, Any]) -> dict[str, Any]:
    """Return the fields that a draft takes unchanged from its table."""
    taken = ("region", "joint", "width", "roll", "stiffness", "weight")
    as_they_are = {name: entry[name] for name in taken}
    return as_they_are | {"left": entry["side"] == "left"}


def single(entry: dict[str, Any], place: Place, store: KindStore, space: Space) -> list[Draft]:
    """The drafts of one [[feather]], two when mirrored. Raises InputError."""
    rotation = _rotation(entry, place, space)
    choice = KindChoice((entry["kind"],), 0.0, _changes(entry, place, store), place)
    draft = Draft(
        id=entry["id"],
        choice=choice,
        position=np.array(entry["position"]),
        rotation=rotation,
        scale=entry["scale"],
        place=place,
        **belonging(entry),
    )
    return with_mirror_images([draft], place, mirror_of(entry, space))


def _check_root(root: dict[str, Any], place: Place) -> None:
    if parallel(root["direction"], root["up"]):
        place.child("up").refuse("is parallel to direction. Give another vector")


def _row_frames(entry: dict[str, Any], path: Array | None) -> tuple[Array, Array]:
    """(n, 3) positions and (n, 3, 3) rotations of a row's roots. path: of its curve."""
    first, last, count = entry["first"], entry["last"], entry["count"]
    fractions = _spaced(count, entry["spacing"])
    points = entry["path"] if path is None else path
    points = (first["position"], last["position"]) if points is None else points
    positions = along_polyline(np.array(points), fractions)
    ends = [frames_from(root["direction"], root["up"]) for root in (first, last)]
    turns = np.tile(np.eye(3), (count, 1, 1))
    if entry["turn_with_path"]:
        turns = transported(positions, fractions)
    rotations = turns @ interpolated(ends[0], turns[-1].T @ ends[1], fractions)
    lift = entry["lift"] * np.arange(count)[:, None] * rotations[:, :, 2]
    return positions + lift, rotations


def _curve(
    entry: dict[str, Any], at: Place, folder: Path, read: CurveReader | None
) -> Array | None:
    """(k, 3) m, the curve of a row; None where it has none."""
    if entry["curve"] is None:
        return None
    if read is None:
        at.refuse("is a USD scene, which featherfx.read_groom and the commands read")
    if entry["path"] is not None:
        at.refuse("stands beside path, expects one of the two")
    found = read(folder, entry["curve"], at)
    if len(found) > 1:
        at.child("prim").refuse(f"holds {len(found)} curves, expects one")
    return found[0]


def _spaced(count: int, ratio: float) -> Array:
    """(count,) from 0 to 1, at distances that grow evenly, the last `ratio` times the first."""
    if count < 3:
        return np.linspace(0.0, 1.0, count)
    steps = np.concatenate([[0.0], np.cumsum(np.linspace(1.0, ratio, count - 1))])
    return np.asarray(steps / steps[-1])


def _row_choices(entry: dict[str, Any], changes: tuple[int, ...], place: Place) -> list[KindChoice]:
    kinds = entry["kind"] if isinstance(entry["kind"], tuple) else (entry["kind"],)
    count = entry["count"]
    choices = []
    for number in range(count):
        if entry["blend"] and len(kinds) > 1:
            at = (len(kinds) - 1) * number / max(count - 1, 1)
            start = min(int(at), len(kinds) - 2)
            choices.append(KindChoice(kinds[start : start + 2], at - start, changes, place))
        else:
            name = kinds[number * len(kinds) // count]
            choices.append(KindChoice((name,), 0.0, changes, place))
    return choices


def row(
    entry: dict[str, Any],
    place: Place,
    store: KindStore,
    space: Space,
    folder: Path,
    read: CurveReader | None,
) -> list[Draft]:
    """The drafts of one [[row]], its mirror image last. Raises InputError.

    folder: of the groom. read: reader of the row's curve.
    """
    path, *_ = all_of(
        partial(_curve, entry, place.child("curve"), folder, read),
        *(partial(_check_root, entry[end], place.child(end)) for end in ("first", "last")),
    )
    frames, count = _row_frames(entry, path), entry["count"]
    digits = max(2, len(str(count)))
    start, end = entry["scale"]
    scales = np.linspace(start, end, count)
    choices = _row_choices(entry, _changes(entry, place, store), place)
    drafts = [
        Draft(
            id=f"{entry['id']}_{number + 1:0{digits}d}",
            choice=choices[number],
            position=frames[0][number],
            rotation=frames[1][number],
            scale=float(scales[number]),
            place=place,
            **belonging(entry),
        )
        for number in range(count)
    ]
    return with_mirror_images(drafts, place, mirror_of(entry, space))


_MAX_DEVIATIONS = 3.0  # standard deviations; keeps lengths positive


def draws(seed: int, ids: Iterable[str]) -> Array:
    """(n, 4) normal draws (length, width, camber, roll), clipped at LIMIT."""
    digests = b"".join(
        hashlib.blake2b(f"{seed}:{name}".encode(), digest_size=64).digest() for name in ids
    )
    words = np.frombuffer(digests, dtype="<u8").reshape(-1, 8) >> np.uint64(11)
    uniform = (words.astype(np.float64) + 0.5) / 2.0**53
    radius = np.sqrt(-2.0 * np.log(uniform[:, :4]))
    return np.clip(radius * np.cos(2.0 * np.pi * uniform[:, 4:]), -_MAX_DEVIATIONS, _MAX_DEVIATIONS)


def variant_number(name: str, variants: int) -> int:
    """Choose one of the variants by the id of a feather."""
    digest = hashlib.blake2b(name.encode(), digest_size=8).digest()
    return int.from_bytes(digest, "little") % variants


_STEPS = 64  # of a painted colour, and of shares by ids
_MINGLED = 0.3  # share of a border in which feathers with and without a film mingle; by eye
_MIXED = ("base", "film", *PIGMENTS)


def shaded(
    colours: Mapping[str, dict[str, Any]], drafts: list[Draft], place: Place, store: KindStore
) -> list[Draft]:
    """The drafts, those between regions with the mean of their colours.

    colours: overrides by patterns of ids, of which the colours of other regions are found as their
    own feathers would have them.
    """
    numbers: dict[tuple[tuple[tuple[str, float], ...], float | None], int] = {}
    shades = {draft.region: _shade(colours, draft.id) for draft in drafts}
    result = []
    for draft in drafts:
        if any(region != draft.region for region, _ in draft.mixture):
            film = _film(shades, draft)
            key = draft.mixture, film
            if key not in numbers:
                mean = _mean(shades, draft.mixture)
                numbers[key] = store.shade(mean if film is None else mean | {"film": film}, place)
            changes = (*draft.choice.changes, numbers[key])
            draft = replace(draft, choice=replace(draft.choice, changes=changes))
        result.append(draft)
    return result


def painted(drafts: list[Draft], place: Place, store: KindStore) -> list[Draft]:
    """The drafts, those that stand on a painted skin with its colour as their base."""
    numbers: dict[tuple[float, ...], int] = {}
    result = []
    for draft in drafts:
        if draft.paint:
            # few enough that feathers share their kinds
            base = tuple(round(round(each * _STEPS) / _STEPS, 4) for each in draft.paint)
            if base not in numbers:
                numbers[base] = store.shade({"base": base} | dict.fromkeys(PIGMENTS, 0.0), place)
            changes = (*draft.choice.changes, numbers[base])
            draft = replace(draft, choice=replace(draft.choice, changes=changes))
        result.append(draft)
    return result


def _film(shades: Mapping[str, dict[str, Any]], draft: Draft) -> float | None:
    """m, thickness of a feather's film between regions: their mean; where some have none, that of
    one of them, by the feather's id, as thinner films have other colours. None where none has one.
    """
    films = [(shades.get(region, {}).get("film", 0.0), part) for region, part in draft.mixture]
    if not any(film for film, _ in films):
        return None
    if all(film for film, _ in films):
        return round(sum(film * part for film, part in films), 10)
    chosen = 0.5 + _MINGLED * (variant_number(draft.id, _STEPS) / _STEPS - 0.5)
    before = np.cumsum([part for _, part in films])
    return float(films[int(np.searchsorted(before[:-1], chosen, side="right"))][0])


def _mean(
    shades: Mapping[str, dict[str, Any]], mixture: tuple[tuple[str, float], ...]
) -> dict[str, Any]:
    """Base (sRGB) and pigments; empty where a region has no colour."""
    own = [(shades.get(region, {}), part) for region, part in mixture]
    if not all(shade for shade, _ in own):
        return {}
    usual = {"base": displayed(np.array(VANE_COLOUR))} | dict.fromkeys(PIGMENTS, 0.0)
    found = {
        name: np.round(sum(part * np.array(s.get(name, plain)) for s, part in own), 4).tolist()
        for name, plain in usual.items()
        if any(name in shade for shade, _ in own)
    }
    return {name: tuple(each) if name == "base" else each for name, each in found.items()}


def _shade(colours: Mapping[str, dict[str, Any]], name: str) -> dict[str, Any]:
    """Base colour, film and pigments of a feather by its id."""
    found: dict[str, Any] = {}
    for pattern, change in colours.items():
        if fnmatch.fnmatchcase(name, pattern):
            found |= {key: each for key, each in change["colour"].items() if key in _MIXED}
    return found
