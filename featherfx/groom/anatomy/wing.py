"""[[wing]]: a whole wing from its joints and a type.

Every flight feather stands on a bone, and its follicle turns with the angle of the wrist: between
forearm and hand, by a share that grows from feather to feather outwards, so that the fan closes
like a hand of cards. A row of coverts has a feather for each flight feather, parallel to it and
curved alike, farther up its shaft and farther from the bone. Inner feathers lie over outer ones.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from featherfx.algebra.types import Array, Indices
from featherfx.algebra.vectors import applied, from_rotation_vector, motions, screws_of, unit
from featherfx.errors import InputWarning, all_of, count_feathers
from featherfx.groom.anatomy.remiges import (
    MAX_SLANT,
    REMEX_ROWS,
    FoldedRow,
    Remiges,
    WingBones,
    along,
    as_placed,
    curvature_of,
    depths,
    folded,
    frames_at,
    marks_of,
    remiges_of,
    sheet_of,
    spread_evenly,
)
from featherfx.groom.anatomy.sheet import Sheet
from featherfx.groom.anatomy.wing_skin import WingSkin, find_wing_skin
from featherfx.groom.keys.anatomy import CovertRow, FlightRow, WingBand, WingType
from featherfx.groom.keys.problems import Place, Problems
from featherfx.groom.materials import Pattern
from featherfx.groom.presets.library import Library, plain, sourced
from featherfx.groom.presets.presets import KindChoice, KindStore
from featherfx.groom.read.drafts import Draft
from featherfx.groom.types import FeatherKind, Joint, Turning

_BONES = ("shoulder", "elbow", "wrist")
_SINGULAR = {"tertials": "tertial", "secondaries": "secondary", "primaries": "primary"}
_ALULA = (0.02, 0.2)
BENT_HEIGHT = 1.12  # of rows, over that over a flat wing, of a bent sheet; free of crossings
_QUILL_ROOM = 0.4  # of a quill's diameter, at least from root to root


class _Closed(NamedTuple):
    """A wing that is folded, in its plane, its flight feathers, and how they bend."""

    wing: _Wing
    remiges: Remiges
    sheet: Sheet


@dataclass(frozen=True)
class _Wing:
    """A wing on its way into a groom. scale: of the feathers. closed: the same wing folded, where
    it bends as it folds. marks: changes by the region and place of feathers that bands mark."""

    entry: dict[str, Any]
    place: Place
    kind: WingType
    bones: WingBones
    store: KindStore
    scale: float
    closed: _Closed | None = None
    marks: Mapping[tuple[str, int], tuple[int, ...]] = field(default_factory=dict)

    def joint(self, bone: int) -> str:
        return f"{self.entry['id']}_{_BONES[bone]}"

    @property
    def type_place(self) -> Place:
        """Place of its type; a bird's wing has it in the type of the bird."""
        of_bird = isinstance(self.entry["type"], WingType)
        return self.place.child("type.wing" if of_bird else "type")


def wing(
    entry: dict[str, Any], place: Place, store: KindStore, library: Library, axes: Array
) -> tuple[list[Draft], list[Joint]]:
    """The drafts of one [[wing]] and its joints. Raises InputError.

    entry: checked keys. axes: (3, 3) of the body, x forward, y to its left, z up.
    """
    kind = wing_type(entry["type"], place.child("type"), library)
    entry = entry | {"scale": entry["scale"] or _scale_of_bones(entry, kind)}
    bones = _bones(entry, place, kind, axes)
    found = _Wing(entry, place, kind, bones, store, entry["scale"])
    remiges, skin = remiges_of(kind, bones, entry["scale"]), entry.get("on")
    usual = entry["scale"] * np.array([kind.humerus, kind.forearm, kind.hand])
    remiges = remiges if skin is None else skin.fit(remiges, bones, usual)
    found = replace(found, closed=None if skin else _closed(found, axes))
    _check(found, remiges, axes)
    rows = list(_rows(found, remiges))
    found = replace(found, marks=_marks(found, rows, axes)) if kind.bands else found
    drafts = [draft for row in rows for draft in _feathers(found, remiges, row)]
    drafts += _alula(found)
    return drafts, _joints(found)


def skin_of_wing(entry: dict[str, Any], at: Place, axes: Array, corners: Array) -> WingSkin | None:
    """The part of a skin (T, 3, 3) m that is the wing of a [[wing]]; None without any."""
    bones = _bones(entry, at, entry["type"], axes)
    return find_wing_skin(bones, remiges_of(entry["type"], bones, entry["scale"]), corners)


def _shut(wing: _Wing, axes: Array) -> tuple[_Wing, Remiges]:
    """The wing as it is folded, flat, and its flight feathers."""
    bones = wing.bones
    shut = folded(wing.kind, bones.points[0], bones.lengths, axes, bones.left, 1.0)
    return replace(wing, bones=shut), remiges_of(wing.kind, shut, wing.scale)


def _closed(wing: _Wing, axes: Array) -> _Closed | None:
    shut, remiges = _shut(wing, axes)
    sheet = wing.entry.get("sheet") or sheet_of(wing.kind, shut.bones, remiges, wing.scale)
    return None if sheet is None else _Closed(shut, remiges, sheet)


def _marks(
    wing: _Wing, rows: Sequence[_Row], axes: Array
) -> dict[tuple[str, int], tuple[int, ...]]:
    """Changes by the region and place of feathers that bands mark. Raises InputError."""
    shut, remiges = _shut(wing, axes)
    plane = shut.bones.frames[1][:, :2]
    known = {
        row.region.removesuffix("s") if "covert" in row.region else row.region: row for row in rows
    }
    found: dict[tuple[str, int], tuple[int, ...]] = {}
    for number, band in enumerate(wing.kind.bands):
        place = wing.type_place.child(f"bands[{number}].rows")
        for k, name in enumerate(band.rows):
            if name not in known:
                told = f"'{name}' is none of {', '.join(known)}. Name rows of the wing"
                place.item(k).refuse(f"{told}, or give bands = []")
        own = [known[name] for name in band.rows if len(known[name].own)]
        flat = []
        for row in own:
            roots, frames = _in_plane(shut, remiges, row)
            ways = unit(frames[:, :, 0] @ plane)
            calamus = wing.store.kind(_choice(wing, row.kind)).calamus
            flat.append(FoldedRow(roots @ plane, ways, row.lengths, calamus))
        steep: list[tuple[float, str]] = []
        for row, marks in zip(own, marks_of(band, flat) if flat else [], strict=True):
            for k, mark in enumerate(marks):
                if isinstance(mark, Pattern):
                    key = row.region, k
                    found[key] = (*found.get(key, ()), wing.store.mark(mark, place))
                elif mark is not None:
                    steep.append((mark, f"{row.name}_{row.numbers[k]:02d}"))
        if steep:
            _warn_of_steep_band(wing.type_place.child(f"bands[{number}]"), steep)
    return found


def _warn_of_steep_band(place: Place, steep: Sequence[tuple[float, str]]) -> None:
    """Warn of feathers without a band that runs along them. steep: deg and name of each."""
    lean, name = max(steep)
    warnings.warn(
        f"{place.source}: {place.key}: leans by more than {MAX_SLANT:g} degrees on "
        f"{count_feathers(len(steep))} and is left out there, as on '{name}', by {lean:.0f}. Bring "
        "`inner` nearer to the place of `outer` along the wing",
        InputWarning,
        stacklevel=2,
    )


def wing_type(given: Any, place: Place, library: Library) -> WingType:
    """A type as it is written, with its bases. Raises InputError."""
    if isinstance(given, WingType):
        return given
    values = plain(library.merged("wing", sourced(given, place.source), place))
    values |= {name: FlightRow(**values[name]) for name in (*REMEX_ROWS, "alula")}
    if not any(values[name].count for name in REMEX_ROWS):
        told = "0, and secondaries and tertials have none either. Give a wing flight feathers"
        place.child("primaries.count").refuse(told)
    values["coverts"] = tuple(CovertRow(**each) for each in values["coverts"])
    values["bands"] = tuple(WingBand(**each) for each in values["bands"])
    return WingType(**values)


def _scale_of_bones(entry: dict[str, Any], kind: WingType) -> float:
    """Lengths of bones between all of a wing's landmarks over the type's; 1 without them."""
    ends = [entry[name] for name in ("shoulder", "elbow", "wrist", "tip")]
    if any(end is None for end in ends):
        return 1.0
    own = np.linalg.norm(np.diff(np.array(ends), axis=0), axis=1).sum()
    return max(float(own), 1e-9) / (kind.humerus + kind.forearm + kind.hand)


def _bones(entry: dict[str, Any], place: Place, kind: WingType, axes: Array) -> WingBones:
    names = ("elbow", "wrist", "tip")
    missing = [name for name in names if entry[name] is None]
    left, fold, scale = entry["side"] == "left", entry["fold"], entry["scale"]
    shoulder = np.array(entry["shoulder"])
    lengths = scale * np.array([kind.humerus, kind.forearm, kind.hand])
    if missing and (len(missing) < len(names) or fold is None):
        told = "missing: expects elbow, wrist and tip, or fold without them"
        place.child(missing[0]).refuse(told)
    if missing:
        return folded(kind, shoulder, lengths, axes, left, fold)
    points = np.array([entry[name] for name in ("shoulder", *names)])
    lengths = np.linalg.norm(np.diff(points, axis=0), axis=1)
    if lengths.min() < 1e-4:
        name = names[int(np.argmin(lengths))]
        place.child(name).refuse("is where the joint before it is. Give bones a length")
    if fold is not None:
        return folded(kind, shoulder, lengths, axes, left, fold)
    dorsal = None
    if skin := entry.get("on"):
        # meshes end where feathers do, beyond the bones of the hand
        points[3] = points[2] + min(1.0, kind.hand / kind.forearm * lengths[1] / lengths[2]) * (
            points[3] - points[2]
        )
        dorsal = skin.axes[:, 2]
    bones = as_placed(kind, points, axes, left, dorsal)
    if bones is None:
        place.child("tip").refuse("shoulder, elbow, wrist and tip are on one line. Give fold")
    return bones


def _check(wing: _Wing, remiges: Remiges, axes: Array) -> None:
    """Raises InputError unless feathers fit their bones and point backwards."""
    problems, rows = Problems(), [getattr(wing.kind, name) for name in REMEX_ROWS]
    rows += [wing.kind.alula] if wing.kind.alula.count else []
    rows += [row for row in wing.kind.coverts if row.side == "above" or wing.entry["below"]]
    kinds = all_of(*(partial(wing.store.kind, _choice(wing, row.kind)) for row in rows))
    place, type_place = (replace(p, problems=problems) for p in (wing.place, wing.type_place))
    for number, (name, row, kind) in enumerate(zip(REMEX_ROWS, rows, kinds, strict=False)):
        own = remiges.bone == number
        if own.sum() < 2:
            continue
        apart = float(np.linalg.norm(np.diff(remiges.roots[own], axis=0), axis=1).min())
        quill = kind.rachis.diameter_base * float(remiges.lengths[own].max()) / kind.length
        room = apart / (_QUILL_ROOM * quill)
        if room < 1.0:
            smaller = f", or the wing a scale up to {wing.scale * room:.2g}"
            type_place.child(f"{name}.count").fail(
                f"{row.count} feathers with quills of {1e3 * quill:.3g} mm stand {1e3 * apart:.3g} "
                f"mm apart on a bone of {1e3 * wing.bones.lengths[number]:.3g} mm. Give up to "
                f"{1 + int((row.count - 1) * room)}{smaller if wing.entry['elbow'] else ''}"
            )
    middle = remiges.bone == 1
    ways = frames_at(wing.bones, remiges.angles[middle])[:, :, 0]
    if len(ways) and float((ways.mean(axis=0)) @ axes[:, 0]) > 0.5:
        told = "the feathers would point forwards: are landmarks, or the sides, exchanged?"
        place.child("wrist").fail(told)
    problems.hand_on()


def _choice(wing: _Wing, name: str) -> KindChoice:
    return KindChoice((name,), 0.0, (), wing.type_place)


def about_y(angle: float) -> Array:
    """(3, 3) rotation about y; positive lowers x. angle: rad."""
    return from_rotation_vector(np.array([0.0, angle, 0.0]))


@dataclass(frozen=True)
class _Row:
    """Feathers of a wing that are of one sort; arrays are over all of the row.

    own: which remiges they belong to. height: m, of roots above the bones. forward: (n,) m.
    loose: whether a layout may move them.
    """

    kind: str
    name: str
    region: str
    width: float
    height: float
    own: Indices
    lengths: Array
    forward: Array
    numbers: tuple[int, ...]
    loose: bool = False


def _rows(wing: _Wing, remiges: Remiges) -> Iterator[_Row]:
    """Rows of flight feathers, then of coverts."""
    for number, name in enumerate(REMEX_ROWS):
        row, own = getattr(wing.kind, name), np.flatnonzero(remiges.bone == number)
        yield _Row(
            kind=row.kind,
            name=_SINGULAR[name],
            region=name,
            width=row.width,
            height=0.0,
            own=own,
            lengths=remiges.lengths[own],
            forward=np.zeros(len(own)),
            numbers=tuple(remiges.numbers[k] for k in own),
        )
    for number, covert in enumerate(wing.kind.coverts):
        if covert.side == "above" or wing.entry["below"]:
            yield _covert_row(wing, remiges, number)


def _covert_row(wing: _Wing, remiges: Remiges, number: int) -> _Row:
    """number: of the row in the type."""
    row = wing.kind.coverts[number]
    _, height = _stacked(wing, row.side, number + 1)
    sign = 1 if row.side == "above" else -1
    arm = int((remiges.bone < 2).sum())
    count = len(remiges.rows) if row.hand > 0.0 else arm
    hand = np.arange(1.0 - arm, count - arm + 1.0) / max(0.5 * wing.kind.primaries.count, 1.0)
    return _Row(
        kind=row.kind,
        name=row.name,
        region=f"{row.name}s",
        width=row.width,
        height=sign * height,
        own=np.arange(count),
        lengths=(1.0 + (row.hand - 1.0) * np.clip(hand, 0.0, 1.0))
        * row.length
        * remiges.lengths[:count],
        forward=row.chord_position * remiges.forward[:count],
        numbers=tuple(range(1, count + 1)),
        loose=row.loose,
    )


def _stacked(wing: _Wing, side: str, count: int, hand: bool = False) -> tuple[int, float]:
    """Return how many of the first covert rows are on a side (of the hand), and their height, m."""
    rows = wing.kind.coverts[:count]
    gaps = [each.gap for each in rows if each.side == side and (not hand or each.hand > 0.0)]
    return len(gaps), wing.scale * sum(gaps)


def _alula(wing: _Wing) -> Iterator[Draft]:
    """Feathers of the thumb, along the leading edge of the hand and over its coverts."""
    row = wing.kind.alula
    if not row.count:
        return
    level, height = _stacked(wing, "above", len(wing.kind.coverts), hand=True)
    thumb = _thumb(wing)
    part = _Row(
        kind=row.kind,
        name="alula",
        region="alula",
        width=row.width,
        height=(1.0 + 0.5 / max(level, 1)) * height,
        own=np.arange(row.count),
        lengths=thumb.lengths,
        forward=thumb.forward,
        numbers=thumb.numbers,
    )
    closed = wing.closed
    shut = None if closed is None else closed._replace(remiges=_thumb(closed.wing))
    yield from _feathers(replace(wing, closed=shut), thumb, part)


def _thumb(wing: _Wing) -> Remiges:
    row, bones = wing.kind.alula, wing.bones
    # beside the primaries, not over them
    across = wing.kind.depth * bones.lengths[2] * np.linspace(0.5, 1.0, row.count)
    edge = -bones.turn * across[:, None] * bones.frames[2][:, 1]
    return Remiges(
        rows=("alula",) * row.count,
        numbers=tuple(range(1, row.count + 1)),
        bone=np.full(row.count, 2),
        roots=edge + along(bones.points[2], bones.points[3], _ALULA, row.count),
        angles=np.full(row.count, bones.bend) + float(wing.kind.outermost[0]),
        fractions=np.ones(row.count),
        lengths=wing.scale * spread_evenly(row.lengths, row.count),
        forward=np.zeros(row.count),
        widening=np.ones(row.count),
    )


def _feathers(wing: _Wing, remiges: Remiges, row: _Row) -> Iterator[Draft]:
    if not len(row.own):
        return
    entry, closed = wing.entry, wing.closed
    choice = _choice(wing, row.kind)
    kind = wing.store.kind(choice)
    positions, rotations = _in_plane(wing, remiges, row)
    bows: Sequence[Array | None] = [None] * len(row.own)
    wraps = np.zeros((len(row.own), 2))
    if closed is not None:
        flat, plane = _in_plane(closed.wing, closed.remiges, row)
        points, frames, within = _on_sheet(closed, row)
        carrier = rotations @ plane.swapaxes(1, 2)
        away = points - flat - closed.sheet.shift
        bent = positions + applied(carrier, away), carrier @ frames
        screws = screws_between((positions, rotations), bent)
        bows = list(screws)
        fraction = max(float(wing.bones.fold[2]), 0.0)
        turns, shifts = motions(fraction * screws)
        positions = applied(turns, positions) + shifts + fraction * closed.sheet.shift
        rotations = turns @ rotations
        inside = _inside(kind, row.width * row.lengths, within)
        wraps = fraction * closed.sheet.bend * row.lengths[:, None] * inside
    curls = np.degrees(curvature_of(wing.kind, wing.scale) * row.lengths)
    if skin := entry.get("on"):
        laid = skin.lay(positions, rotations[:, :, 0], row.lengths, row.height)
        positions, rotations, curls = laid.roots, laid.frames, np.degrees(laid.bends)
        wraps = np.repeat(laid.wraps[:, None], 2, axis=1)
    for k, remex in enumerate(row.own):
        length = float(row.lengths[k])
        yield Draft(
            id=f"{entry['id']}_{row.name}_{row.numbers[k]:02d}",
            choice=replace(choice, changes=wing.marks.get((row.region, k), ())),
            position=positions[k],
            rotation=rotations[k],
            region=row.region,
            joint=wing.joint(int(remiges.bone[remex])),
            left=wing.bones.left,
            skin=entry["skeleton"],
            scale=length / kind.length,
            width=row.width * float(remiges.widening[remex]),
            roll=wing.kind.roll,
            place=wing.place,
            curl=float(curls[k]) - kind.rachis.camber,
            wrap=(float(wraps[k, 0]), float(wraps[k, 1])),
            grown=row.loose,
            turning=Turning(
                joints=(wing.joint(1), wing.joint(2)),
                fraction=float(remiges.fractions[remex]),
                anchor=remiges.roots[remex],
                bow=bows[k],
            ),
        )


def _on_sheet(closed: _Closed, row: _Row) -> tuple[Array, Array, Array]:
    """A row of a folded wing before rolls, as of `Sheet.lay`."""
    remiges, wing = closed.remiges, closed.wing
    frames = frames_at(wing.bones, remiges.angles[row.own])
    heights = BENT_HEIGHT * row.height - wing.scale * wing.kind.lift * depths(remiges)[row.own]
    shift = heights[:, None] * frames[:, :, 2] - row.forward[:, None] * frames[:, :, 0]
    roots = remiges.roots[row.own] + shift
    return closed.sheet.lay(roots, frames[:, :, 0], row.lengths)


def _inside(kind: FeatherKind, sizes: Array, within: Array) -> Array:
    """(n, 2) share of the leading and of the trailing vane that lies inwards of a sheet's edge.

    sizes: (n,) m, factors of the outlines' widths. within: (n,) m, from the shaft outwards to the
    edge.
    """
    widest = [max(y for _, y in vane.outline) for vane in (kind.leading, kind.trailing)]
    return np.clip(within[:, None] / np.outer(sizes, widest) + (0.0, 1.0), 0.0, 1.0)


def screws_between(first: tuple[Array, Array], last: tuple[Array, Array]) -> Array:
    """(n, 6) screws that take roots (n, 3) m and frames (n, 3, 3) to others."""
    turns = last[1] @ first[1].swapaxes(1, 2)
    return screws_of(turns, last[0] - np.einsum("nij,nj->ni", turns, first[0]))


def _in_plane(wing: _Wing, remiges: Remiges, row: _Row) -> tuple[Array, Array]:
    """Roots (n, 3) m and frames (n, 3, 3) of a row before rolls, in the wing's plane."""
    frames = frames_at(wing.bones, remiges.angles[row.own])
    # on the flight feather's own arc, carried on towards the leading edge
    raised = curvature_of(wing.kind, wing.scale) * row.forward
    heights = (
        row.height
        - wing.scale * wing.kind.lift * depths(remiges)[row.own]
        - 0.5 * raised * row.forward
    )
    shift = heights[:, None] * frames[:, :, 2] - row.forward[:, None] * frames[:, :, 0]
    turned = np.stack(
        [frame @ about_y(-angle) for frame, angle in zip(frames, raised, strict=True)]
    )
    return remiges.roots[row.own] + shift, turned


def _joints(wing: _Wing) -> list[Joint]:
    side = 1 if wing.bones.left else -1
    return [
        Joint(
            name=wing.joint(number),
            position=wing.bones.points[number],
            parent=wing.joint(number - 1) if number else wing.entry["joint"],
            role=role,
            side=side,
            hinge=wing.bones.hinges[number],
            fold=float(wing.bones.fold[number]),
            bone=wing.bones.points[number : number + 2].mean(axis=0),
            offset=None if number or wing.closed is None else wing.closed.sheet.shift,
        )
        for number, role in enumerate(_BONES)
    ]
