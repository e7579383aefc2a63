"""Feathers of a groom on the leaves of its coat: their rest shapes and their places.

A coat (featherfx/coat) holds the feathers that regions grow on a skin. Each keeps its plane form,
rachis and barbs exactly as long; camber and twist are those of its leaf. The rest of the groom
stays as it is placed. Rachises are as high as a leaf has room for. Vanes begin with their first
barbs: a fan from the calamus to these would span the curved base as a chord.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any
from weakref import WeakValueDictionary

import numpy as np

from featherfx.algebra.triangulation import weld
from featherfx.algebra.types import Array, Flags, Indices
from featherfx.algebra.vectors import dots
from featherfx.coat.carrier import refine
from featherfx.coat.coat import (
    Coat,
    PlaneForms,
    StackReport,
    describe_doubts,
    draw,
    grow_coat,
    make_plane_forms,
    stack,
)
from featherfx.coat.fields import CoatSpacing, Follicles
from featherfx.coat.sheets import BearingPoints, raise_onto, sew_fan
from featherfx.errors import count_feathers, warn_input
from featherfx.feather.shapes import build_plane_feathers
from featherfx.feather.types import Feather, FeatherSurface, RowPoints, share, stacked
from featherfx.files.disk_cache import digest, kept
from featherfx.groom.skin.skin import closest
from featherfx.groom.types import Groom, Placement

# of a feather's length: roots that are farther from the skin stand on something else
_MAX_DISTANCE = 0.05
# of the longest of a tail, from its roots to a skin that it does not stand on
_FAN_REACH = 0.25
_ARM = 0.45  # of the way from forearm to hand, up to where feathers are of the arm
# of the longest feather of a wing, from roots: up to where those of the arm bear the coat, and from
# where those of the hand hide it; fewest feathers of pigeon, gull and sparrow cross wings so
_BEARING, _BEHIND = 0.4, 0.35
_SHORTEST_OF_FAN = 0.75  # of the longest of a tail, feathers that are not its coverts
# of the diameter of the rachis at its base: a follicle lies so deep in the skin
_DEPTH = 0.6
# of the gap between leaves, that a rachis is high in a vane
_MAX_HEIGHT = 0.8
# of its length, and rad, that a feather deviates less than asked without a note
_MIN_CUT = 0.005
_MAX_TURN = 60.0  # deg, that a feather turns to those around without a warning
_FOOTPRINT = 11, 4  # rows and columns on which overlaps are found
_FEATHERS_AT_ONCE = 2000  # that are drawn, to bound the memory


class LaidCoat:
    """A coat, how it was stacked, and what was drawn of it.

    shapes: by number, grid, and the identity of the directors of the feather that has the plane
    form, while they are in use. origin: by which digests know it.
    """

    def __init__(self, coat: Coat, report: StackReport) -> None:
        self.coat, self.report = coat, report
        own, mesh = coat.follicles, coat.mesh
        self.origin = (digest(mesh.points, mesh.faces, *coat.fields, *own, coat.values),)
        self.shapes: WeakValueDictionary[tuple[int, int, int, int], Feather] = WeakValueDictionary()


@dataclass(frozen=True, eq=False)
class CoatLeaf:
    """The leaf of a feather: its number among the follicles of a coat."""

    laid: LaidCoat
    number: int


def lie_on_leaves(placements: Sequence[Placement], feathers: Sequence[Feather]) -> list[Feather]:
    """Bend feathers onto their leaves, those that have one. feathers: in their plane forms."""
    found = list(feathers)
    missing: dict[int, list[int]] = {}
    for k, (placement, feather) in enumerate(zip(placements, feathers, strict=True)):
        if placement.leaf is None:
            continue
        known = placement.leaf.laid.shapes.get(_key(placement, feather))
        if known is None:
            missing.setdefault(id(placement.leaf.laid), []).append(k)
        else:
            found[k] = known
    for own in missing.values():
        for start in range(0, len(own), _FEATHERS_AT_ONCE):
            part = own[start : start + _FEATHERS_AT_ONCE]
            bent = _bend([placements[k] for k in part], [feathers[k] for k in part])
            for k, feather in zip(part, bent, strict=True):
                placements[k].leaf.laid.shapes[_key(placements[k], feathers[k])] = feather
                found[k] = feather
    return found


def _key(placement: Placement, feather: Feather) -> tuple[int, int, int, int]:
    return placement.leaf.number, feather.rows, feather.columns, id(feather.rest.directors)


def _bend(placements: Sequence[Placement], feathers: Sequence[Feather]) -> list[Feather]:
    """Draw feathers of one coat and grid on their leaves, each in its own frame."""
    coat: Coat = placements[0].leaf.laid.coat
    numbers = np.array([each.leaf.number for each in placements])
    drawn = draw(coat, coat.rest, plane_forms(placements, feathers), numbers)
    position = np.stack([each.position for each in placements])
    rotation = np.stack([each.rotation for each in placements])
    nodes = (drawn.nodes - position[:, None, None]) @ rotation[:, None]
    directors = drawn.directors @ rotation[:, None]
    # the frame of the root, to the last digit
    nodes[:, 0, 0], directors[:, 0] = 0.0, np.eye(3)[1:]
    nodes.flags.writeable = directors.flags.writeable = False
    room = _MAX_HEIGHT * coat.fields.gap[coat.follicles.triangle]
    trimmed: dict[int, tuple[Flags, Indices, FeatherSurface]] = {}  # by identity of directions
    bent = []
    for k, (feather, r) in enumerate(zip(feathers, numbers, strict=True)):
        key = id(feather.surface.barb_direction)
        if key not in trimmed:
            trimmed[key] = _without_base_fans(feather)
        cell, points, surface = trimmed[key]
        surface = replace(surface, offset=_flat_offsets(feather, room[r])[points])
        surface.offset.flags.writeable = False
        rest = RowPoints(nodes[k], directors[k])
        bent.append(replace(feather, rest=rest, cell=cell, surface=surface))
    return bent


def _without_base_fans(feather: Feather) -> tuple[Flags, Indices, FeatherSurface]:
    """Return cells without the fans at the base, the points (P,) that stay, and their surface."""
    cell, surface = feather.cell.copy(), feather.surface
    for side, grown in enumerate(feather.barb_length > 0.0):
        cell[side, : grown.argmax()] = False
    keep = np.ones(len(surface.triangles), dtype=np.bool_)
    keep[: np.count_nonzero(feather.cell)] = cell[feather.cell]
    points, triangles = np.unique(surface.triangles[keep], return_inverse=True)
    number = np.full(len(surface.row) + 1, -1)  # the last: of lips without a barb above
    number[points] = np.arange(len(points))
    lips = number[surface.lips]
    own = replace(
        surface,
        row=share(surface.row[points]),
        node=share(surface.node[points]),
        triangles=share(triangles.reshape(-1, 3)),
        part=share(surface.part[keep]),
        barb_direction=surface.barb_direction[keep],
        st=surface.st[points],
        lips=share(lips[lips[:, 0] >= 0]),
    )
    return share(cell), share(points), own


def _flat_offsets(feather: Feather, room: float) -> Array:
    """Return (V, 2) m, offsets of a rachis that is no higher than a room beyond the calamus."""
    surface = feather.surface
    low = np.minimum(1.0, room / np.maximum(feather.height, 1e-12))
    bare = (feather.barb_length > 0.0).any(axis=0).argmax()
    low[: max(bare - 1, 0)] = 1.0
    scale = np.stack([np.ones(len(surface.row)), low[surface.row]], axis=1)
    return np.asarray(surface.offset * scale)


def plane_forms(placements: Sequence[Placement], feathers: Sequence[Feather]) -> PlaneForms:
    """Plane forms of feathers of one grid."""
    bare = [p.kind.calamus * p.kind.length for p in placements]
    return make_plane_forms(
        nodes=np.stack([each.rest.nodes for each in feathers]),
        directors=np.stack([each.rest.directors for each in feathers]),
        bare=np.array(bare),
    )


def lay_out(groom: Groom) -> Groom:
    """The groom with the feathers of its regions on the leaves of one coat, if it has a layout.

    Gives an InputWarning where the flow of the feathers is singular, and where leaves have no
    room. Raises InputError for shapes that cannot be built.
    """
    members = _coat_members(groom)
    if not members:
        return groom
    chosen = [groom.feathers[k] for k in members]
    laid, forms = _grow(groom, chosen)
    doubts = [
        *describe_doubts(laid.coat),
        *_describe_turns(laid, chosen),
        *_describe_crowds(laid, chosen),
    ]
    for message in doubts:
        warn_input(f"{_place_of(groom)}: {message}", 3)
    roots = draw(laid.coat, laid.coat.rest, forms)
    dorsal, lateral = roots.directors[:, 0, 1], roots.directors[:, 0, 0]
    frames = np.stack([np.cross(lateral, dorsal), lateral, dorsal], axis=2)
    feathers = list(groom.feathers)
    # who starts upstream lies over those behind
    ranks = np.empty(len(members), dtype=np.int64)
    ranks[np.argsort(-laid.coat.values, kind="stable")] = np.arange(len(members))
    for number, k in enumerate(members):
        feathers[k] = replace(
            feathers[k],
            position=roots.nodes[number, 0, 0].copy(),
            rotation=frames[number].copy(),
            rank=int(ranks[number]),
            leaf=CoatLeaf(laid, number),
        )
    return replace(groom, feathers=tuple(feathers), coat=laid)


def _place_of(groom: Groom) -> str:
    """Return what messages about a groom's layout begin with: file, key, and prim of the skin."""
    prim = (groom.skin_keys or {}).get("prim")
    return f"{groom.source}: layout" + (f": {prim}" if prim else "")


def _coat_members(groom: Groom) -> list[int]:
    """Numbers of the feathers that grow on the skin itself."""
    grown = [k for k, each in enumerate(groom.feathers) if each.grown]
    if groom.layout is None or groom.skin is None or not grown:
        return []
    places = np.stack([groom.feathers[k].position for k in grown])
    triangle, place = closest(places, groom.skin)
    gaps = np.einsum("fk,fkc->fc", place, groom.skin[triangle]) - places
    length = np.array([groom.feathers[k].kind.length for k in grown])
    near = np.linalg.norm(gaps, axis=1) <= _MAX_DISTANCE * length
    return [k for k, is_near in zip(grown, near, strict=True) if is_near]


def _grow(groom: Groom, chosen: Sequence[Placement]) -> tuple[LaidCoat, PlaneForms]:
    """Grow and stack the coat of some feathers of a groom; also their footprints."""
    skin, layout = groom.skin, groom.layout
    assert skin is not None
    assert layout is not None
    roots = np.stack([each.position for each in chosen])
    length = np.array([each.kind.length for each in chosen])
    points, faces = _sew_tails(groom, *refine(*weld(skin), roots, length))
    onto = [each for each in groom.feathers if each.grown and each.turning is not None]
    if onto:
        flow = np.mean([each.rotation[:, 0] for each in onto], axis=0)
        how = points, faces, _find_bearers(groom, onto), flow
        points = kept("raised", how, lambda: {"points": raise_onto(*how)})["points"]
    triangle, place = closest(roots, points[faces])
    foot = np.einsum("fk,fkc->fc", place, points[faces][triangle])
    covered = np.linalg.norm(foot - roots, axis=1) > _MAX_DISTANCE * length
    places = np.where(covered[:, None], foot, roots)
    kinds = [each.kind for each in chosen]
    frames = np.stack([each.rotation for each in chosen])
    follicles = Follicles(
        triangle=triangle,
        place=place,
        position=places,
        heading=frames[:, :, 0],
        lateral=frames[:, :, 1],
        length=np.array([kind.length for kind in kinds]),
        width=np.array([kind.width for kind in kinds]),
        depth=_DEPTH * np.array([kind.rachis.diameter_base for kind in kinds]),
    )
    forms = plane_forms(chosen, build_plane_feathers(chosen, *_FOOTPRINT))
    coat = grow_coat(points, faces, follicles, CoatSpacing(layout.thickness, layout.gap))
    return LaidCoat(*stack(coat, forms)), forms


def _find_bearers(groom: Groom, onto: Sequence[Placement]) -> BearingPoints:
    """Points of folded wings that the coat lies on. onto: their loose coverts."""
    joints = {each.turning.joints for each in onto if each.turning}
    turns = [(each, each.turning) for each in groom.feathers if each.turning and not each.grown]
    rows = [(each, turning) for each, turning in turns if turning.joints in joints]
    nodes = _nodes_of([each for each, _ in rows])
    away = np.linalg.norm(nodes - nodes[:, :1, :1], axis=3)
    arm = np.array([turning.fraction < _ARM for _, turning in rows])[:, None, None]
    near = away <= np.where(arm, _BEARING, _BEHIND) * away.max()
    return BearingPoints(_nodes_of(onto).reshape(-1, 3), nodes[near & arm], nodes[~near])


def _nodes_of(placements: Sequence[Placement]) -> Array:
    """(K, n, 1 + 2 m, 3) m, of K feathers on a coarse grid."""
    rest = stacked([each.rest for each in build_plane_feathers(placements, *_FOOTPRINT)])
    turns = np.stack([each.rotation for each in placements])
    roots = np.stack([each.position for each in placements])[:, None, None]
    return np.asarray(np.einsum("kij,kncj->knci", turns, rest.nodes) + roots)


def _sew_tails(groom: Groom, points: Array, faces: Indices) -> tuple[Array, Indices]:
    """Sew the sheets of tails, whose feathers and coverts the coat lies on, to a skin."""
    fans: dict[str, list[Placement]] = {}
    for each in groom.feathers:
        if each.turning is not None:
            first, second = each.turning.joints
            if second in (f"{first}_right", f"{first}_left"):
                fans.setdefault(first, []).append(each)
    for name, own in fans.items():
        length = np.array([each.kind.length for each in own])
        nodes = _nodes_of(own)
        shafts = nodes[length > _SHORTEST_OF_FAN * length.max(), :, 0]
        before = points
        points, faces = sew_fan(points, faces, shafts, nodes.reshape(-1, 3))
        root = shafts[:, 0].mean(axis=0)
        triangle, place = closest(root[None], points[faces])
        away = np.linalg.norm(place @ points[faces[triangle[0]]] - root)
        if points is before and away < _FAN_REACH * length.max():
            at = ", ".join(f"{x:.3g}" for x in root)
            message = (
                f"{_place_of(groom)}: the skin around the roots of tail '{name}' at ({at}) m"
                " is no tube that one cut closes, so feathers beside it lie on the skin alone and"
                " may pass through it. Give each tail an end of the skin of its own"
            )
            warn_input(message, 4)
    return points, faces


def measure_cut_variation(groom: Groom) -> dict[str, Any]:
    """Measure what leaves have no room for of the tilt, curl and roll of the coat's feathers that a
    groom has.

    Returns how many `feathers` of them deviate less than asked, by `tip` (m) and `roll` (deg):
    median and worst of these, and which is worst. An empty dict where none does.
    """
    if groom.coat is None:
        return {}
    names = {each.leaf.number: each.id for each in groom.feathers if each.leaf is not None}
    own_leaves = sorted(names)  # a share of a bake has some of the leaves
    cut = groom.coat.report.cut[own_leaves]
    length = groom.coat.coat.follicles.length[own_leaves]
    lower, less = cut[:, 0] > _MIN_CUT * length, cut[:, 1] > _MIN_CUT
    found: dict[str, Any] = {"feathers": int((lower | less).sum()), "coat": len(cut)}
    for name, each, own in (("tip", cut[:, 0], lower), ("roll", np.degrees(cut[:, 1]), less)):
        if own.any():
            worst = int(each.argmax())
            found[name] = {"median": float(np.median(each[own])), "worst": float(each[worst])}
            found[name]["feather"] = names[own_leaves[worst]]
    return found if found["feathers"] else {}


def _describe_turns(laid: LaidCoat, chosen: Sequence[Placement]) -> list[str]:
    """Tell which feathers turn to those around, where flows meet."""
    own = np.stack([each.rotation[:, 0] for each in chosen])
    turns = np.degrees(np.arccos(np.clip(dots(own, laid.coat.follicles.heading), -1.0, 1.0)))
    far = np.flatnonzero(turns > _MAX_TURN)
    if not len(far):
        return []
    worst = far[turns[far].argmax()]
    return [
        f"flows that meet turn {count_feathers(len(far))} by more than {_MAX_TURN:g} degrees, as"
        f" '{chosen[worst].id}' by {turns[worst]:.0f}. Give the regions around a flow that"
        " does not meet itself"
    ]


def _describe_crowds(laid: LaidCoat, chosen: Sequence[Placement]) -> list[str]:
    """Tell which feathers found no room between those around them, and of a coat that is none."""
    if laid.report.pairs == 0 and len(chosen) > 1:
        place = ", ".join(f"{x:.3g}" for x in chosen[0].position)
        return [
            f"none of {len(chosen)} feathers lies over another: the skin is bare between them, as"
            f" beside '{chosen[0].id}' at ({place}) m. Give their regions more or longer feathers"
        ]
    crowded = np.flatnonzero(laid.report.shares == 0.0)
    if not len(crowded):
        return []
    return [
        f"there is no room for {count_feathers(len(crowded))} between those around, which they may "
        f"pass through, as '{chosen[crowded[0]].id}'. Lower the density or the length of their "
        "regions, or raise layout.thickness"
    ]
