"""Groom files in: TOML and its tables to a Groom, with every problem found at once."""

from __future__ import annotations

import fnmatch
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from featherfx.algebra.types import Array
from featherfx.algebra.vectors import about_x
from featherfx.errors import warn_input
from featherfx.groom.keys.groom import GROOM_FILE
from featherfx.groom.keys.problems import INVALID, MAX_REPORTED, Place, Problems, closest
from featherfx.groom.presets.kinds import Change
from featherfx.groom.presets.library import Library, sourced
from featherfx.groom.presets.presets import KindStore
from featherfx.groom.read import drafts as draft_rules
from featherfx.groom.read.drafts import Draft, draws, other_side, painted, shaded, variant_number
from featherfx.groom.read.space import GroomReaders, Space, cache_skins, in_groom
from featherfx.groom.read.toml_file import file_kind, load_toml, told
from featherfx.groom.types import FeatherKind, Groom, Joint, Layout, Placement
from featherfx.limits import MAX_COMPARED, MAX_FEATHERS

_SHOT_KEYS = {"groom", "frames"}  # that every shot has, and no groom
_FEATHER_KEYS = {
    "bird",
    "feather",
    "row",
    "wing",
    "tail",
    "crest",
    "table",
    "usd",
    "region",
}  # of which every groom has one
SCENE_SUFFIXES = (".usd", ".usda", ".usdc", ".usdz")
# changes of feathers by id pattern
Overrides = dict[str, dict[str, Any]]
_WILD = re.compile(r"[*?[]")  # what makes a pattern more than an id
# of [variation], what is drawn besides size, width, camber and roll
_MATTER = (
    "barb_angle", "modulus_across_barbs", "modulus_along_barbs", "thickness", "stiffness", "weight",
)  # fmt: skip
_DRAWS = "/matter", "/bulk"  # after a name, what is drawn of it
_MULTIPLIED = ("scale", "width", "stiffness", "weight")
# lengths of the longest feather, that roots and joints may be apart; in another unit they are
_MAX_SPREAD = 50.0
_SIDES = {"left": 1, "right": -1, "middle": 0}


def read_groom(
    path: str | Path,
    preset_folders: Iterable[str | Path] = (),
    readers: GroomReaders | None = None,
    tables: Mapping[str, Any] | None = None,
) -> Groom:
    """The groom that a TOML file, or a scene that the readers read, describes.

    preset_folders: searched before the user's and the shipped presets. tables: instead of the
    file's. Raises InputError with all problems of the file, its tables and scenes and the presets
    that it names.
    """
    library, groom = Library(preset_folders, Problems()), None
    with library.problems.collecting():
        groom = collect_groom(Path(path), library, readers, tables=tables)
    library.problems.raise_any()
    assert groom is not None
    return groom


def collect_groom(
    path: Path,
    library: Library,
    readers: GroomReaders | None = None,
    above: Iterable[tuple[Overrides, Place]] = (),
    tables: Mapping[str, Any] | None = None,
) -> Groom | None:
    """The groom of a file; None, or an incomplete groom, after adding problems. Raises InputError.

    above: checked [overrides] of a shot, and its place, that come after the groom's. tables:
    instead of the file's.
    """
    raw = load_tables(path) if tables is None else dict(tables)
    place = Place(str(path), "", library.problems)
    if raw.keys() >= _SHOT_KEYS:
        place.refuse("is a shot, expects a groom, as its key groom names one")
    if "flock" in raw:
        place.refuse("is a flock, expects a groom. featherfx bake and check take flocks")
    family = "groom" if _FEATHER_KEYS & raw.keys() else file_kind(raw, path, {})
    if family not in ("groom", ""):
        place.refuse(f"is a {family} preset, expects a groom")
    return groom_of(raw, path, library, readers, above)


def load_tables(path: Path) -> dict[str, Any]:
    """Tables of a TOML file, or one that names a USD scene. Raises InputError."""
    if path.suffix.lower() in SCENE_SUFFIXES:
        return {"name": path.stem, "usd": [{"file": path.name}]}
    return load_toml(path)


def groom_of(
    raw: dict[str, Any],
    path: Path,
    library: Library,
    readers: GroomReaders | None = None,
    above: Iterable[tuple[Overrides, Place]] = (),
    key: str = "",
) -> Groom | None:
    """The groom of tables as they stand in a file at path, under a key; see collect_groom."""
    place = Place(str(path), key, library.problems)
    place.problems.file_keys = place.problems.file_keys or GROOM_FILE.keys - raw.keys()
    parts = GROOM_FILE.parts(raw, place)
    if readers is not None:
        readers = replace(readers, skin=cache_skins(readers.skin))
    space = in_groom(parts, place, None if readers is None else readers.skin)
    store = KindStore(library)
    colours: Overrides = {}
    if parts["bird"] is not None:
        from featherfx.groom.anatomy.bird import hatch

        with library.problems.collecting():
            colours = hatch(parts, place, library, None if readers is None else readers.skin)
    limb_drafts: tuple[Draft, ...] = ()
    limb_joints: tuple[tuple[Joint, Place], ...] = ()
    if parts["wing"] or parts["tail"] or parts["crest"]:
        from featherfx.groom.anatomy.fans import grow_limbs

        limb_drafts, limb_joints = grow_limbs(parts, store, library, space)
    # of a wrong joint, what names it has no fault
    unknown = [each for each in raw if each not in GROOM_FILE.keys]
    misspelt = len(unknown) < MAX_REPORTED and closest("joint", unknown, 1)
    has_all_joints = not misspelt and len(parts["joint"]) == len(_list(raw, "joint"))
    joints = _joints(parts["joint"], limb_joints, space, has_all_joints)
    region_drafts: tuple[Draft, ...] = ()
    skin: Array | None = None
    if raw.get("region") or parts["region"]:
        from featherfx.groom.regions.regions import grow_regions

        region_drafts, skin = grow_regions(raw, parts, place, store, readers, space)
    written = _drafts(parts, path.parent, store, readers, space) if _may_be(parts, place) else ()
    drafts = [*islice(written, MAX_FEATHERS + 1), *limb_drafts, *region_drafts]
    if len(drafts) > MAX_FEATHERS:
        place.refuse(f"holds more than {MAX_FEATHERS} feathers")
    if not drafts and not len(library.problems):
        place.fail(
            "there are no feathers. Give a [bird], [[feather]], [[row]], [[wing]], [[tail]], "
            "[[crest]], [[table]], [[usd]] or [[region]]"
        )
    drafts = _overridden(colours, drafts, place.child("bird"), store, dict.fromkeys(colours, True))
    if colours or any(draft.paint for draft in drafts):
        drafts = shaded(colours, drafts, place.child("bird"), store) if colours else drafts
        drafts = painted(drafts, place.child("skin").child("colours"), store)
    # feathers that are missing for another mistake may be those that a pattern is for
    missed = _written_ids(raw) if len(library.problems) else []
    for rules, at in ((parts["overrides"], place), *above):
        wanted = {pattern: bool(fnmatch.filter(missed, pattern)) for pattern in rules}
        drafts = _overridden(rules, drafts, at.child("overrides"), store, wanted)
    _check_ids(drafts)
    if has_all_joints:
        _check_joints(drafts, joints)
    name = raw.get("name")
    if not isinstance(name, str):
        return None
    placements = _placements(parts["variation"], drafts, store)
    _warn_of_units(placements, joints, place)
    inputs = library.said | told(raw, path.parent)
    is_balance = parts["drawn_pose"] == "equilibrium" and parts["gravity"] is not INVALID
    gravity = np.array(parts["gravity"], dtype=float) if is_balance else None
    return Groom(
        name=name,
        source=path,
        feathers=placements,
        joints=joints,
        layout=Layout(**parts["layout"]) if isinstance(parts["layout"], dict) else None,
        skin=skin,
        drawn_gravity=gravity,
        inputs=inputs,
        skin_keys=None if parts["skin"] is INVALID else parts["skin"],
        forward=_find_forward(parts, space),
    )


def _find_forward(parts: dict[str, Any], space: Space) -> tuple[float, float, float]:
    """The body's forward, level and unit: of the last wing, else of the space."""
    wings = [entry["forward"] for _, entry in parts["wing"]]
    x, y = np.array(wings[-1] if wings else space.forward)[:2].tolist()
    size = float(np.hypot(x, y))
    return (x / size, y / size, 0.0) if size > 0.0 else (1.0, 0.0, 0.0)


def _may_be(parts: dict[str, Any], place: Place) -> bool:
    """Return True if the rows ask for no more feathers than allowed; add a problem otherwise."""
    count = sum(entry["count"] * (2 if entry["mirror"] else 1) for _, entry in parts["row"])
    if count > MAX_FEATHERS:
        place.child("row").fail(f"asks for {count} feathers in all. Give at most {MAX_FEATHERS}")
    return count <= MAX_FEATHERS


def _drafts(
    parts: dict[str, Any],
    folder: Path,
    store: KindStore,
    readers: GroomReaders | None,
    space: Space,
) -> Iterator[Draft]:
    curves, scenes = (readers.curves, readers.feathers) if readers else (None, None)
    for at, entry in parts["feather"]:
        with at.problems.collecting():
            yield from draft_rules.single(entry, at, store, space)
    for at, entry in parts["row"]:
        with at.problems.collecting():
            yield from draft_rules.row(entry, at, store, space, folder, curves)
    for at, entry in parts["table"]:
        from featherfx.groom.read.table import read_table

        with at.problems.collecting():
            yield from read_table(entry, folder, at, space)
    for at, entry in parts["usd"]:
        from featherfx.groom.read.drawn import drawn_drafts

        with at.problems.collecting():
            yield from drawn_drafts(entry, folder, at, store, scenes)


def _joints(
    entries: list[tuple[Place, dict[str, Any]]],
    grown: Sequence[tuple[Joint, Place]],
    space: Space,
    has_all: bool,
) -> tuple[Joint, ...]:
    """Those written, then those of wings and the like. has_all: whether none was left out."""
    found: dict[str, tuple[Joint, Place]] = {}
    written = [(each, at) for at, entry in entries for each in _joint_pair(entry, at, space)]
    for joint, at in [*written, *grown]:
        if joint.name in found:
            other = found[joint.name][1].key
            at.child("name").fail(f"'{joint.name}' is taken by {other}. Choose another")
        else:
            found[joint.name] = joint, at
    faulty = set()
    for joint, at in found.values():
        # a mirror image repeats the mistake of what is written
        if has_all and joint.parent and joint.parent not in found and at.key not in faulty:
            faulty.add(at.key)
            at.child("parent").unknown(f"no joint '{joint.parent}'", joint.parent, found)
    parents = {name: joint.parent for name, (joint, _) in found.items()}
    for cycle in _cycles(parents):
        names = [*cycle, cycle[0]]
        if len(names) > MAX_REPORTED:
            names[MAX_REPORTED - 1 : -1] = ["..."]
        at = found[cycle[0]][1]
        if at.key not in faulty:
            faulty.add(at.key)
            told = f"joint cycle: {' -> '.join(names)}. Give one of them another parent"
            at.child("parent").fail(told)
    return tuple(joint for joint, _ in found.values())


def _cycles(parents: dict[str, str]) -> Iterator[list[str]]:
    """Names that are their own ancestors, each loop once, from a name on to its parents.

    parents: by name; a name without an entry ends a chain. Every name is passed once.
    """
    passed: dict[str, str] = {}  # by name, where the walk began that passed it
    for first in parents:
        if first in passed:
            continue
        name = first
        while name in parents and name not in passed:
            passed[name] = first
            name = parents[name]
        if passed.get(name) != first:
            continue
        loop = [name]
        while parents[loop[-1]] != name:
            loop.append(parents[loop[-1]])
        yield loop


def _joint_pair(entry: dict[str, Any], at: Place, space: Space) -> list[Joint]:
    position = np.array(entry["position"])
    side = _SIDES[entry["side"]]
    joint = Joint(entry["name"], position, entry["parent"], entry["role"], side)
    mirror = draft_rules.mirror_of(entry, space)
    if mirror is None:
        return [joint]
    name = other_side(joint.name)
    if name is None:
        at.child("name").fail(f'\'{joint.name}\' must hold "left" or "right" to be mirrored')
        return [joint]
    parent = other_side(joint.parent) or joint.parent
    return [joint, Joint(name, mirror.points(position), parent, joint.role, -side)]


def _written_ids(raw: Mapping[str, Any]) -> list[str]:
    """Ids as [[feather]] and [[row]], or misspelt ones, would have them, of a row the first."""
    names = [
        f"{each['id']}{'_01' if 'count' in each else ''}"
        for kind in raw
        for each in _list(raw, kind)
        if isinstance(each.get("id"), str)
    ]
    return [*names, *filter(None, map(other_side, names))]


def _list(raw: Mapping[str, Any], key: str) -> list[dict[str, Any]]:
    found = raw.get(key)
    return [each for each in found if isinstance(each, dict)] if isinstance(found, list) else []


def _overridden(
    rules: Overrides,
    drafts: list[Draft],
    place: Place,
    store: KindStore,
    may_miss: Mapping[str, bool],
) -> list[Draft]:
    """The drafts with [overrides] applied, pattern by pattern. may_miss: whether each may match no
    feather."""
    numbers: dict[str, list[int]] = {}
    for index, draft in enumerate(drafts if rules else ()):
        numbers.setdefault(draft.id, []).append(index)
    for pattern, entry in rules.items():
        at = place.child(f'"{pattern}"')
        change = dict(entry)
        factors = {name: change.pop(name, 1.0) for name in _MULTIPLIED}
        roll = change.pop("roll", 0.0)
        number = (store.change(sourced(change, place.source), at),) if change else ()
        if _WILD.search(pattern):
            matches = re.compile(fnmatch.translate(pattern)).match
            hits = [index for index, draft in enumerate(drafts) if matches(draft.id)]
        else:
            hits = numbers.get(pattern, [])
        if not hits and not may_miss[pattern]:
            at.fail(f"matches no feather id, {_likely_id(pattern, drafts, at.problems)}")
        for index in hits:
            draft = drafts[index]
            drafts[index] = replace(
                draft,
                choice=replace(draft.choice, changes=draft.choice.changes + number),
                roll=draft.roll + roll,
                **{name: getattr(draft, name) * each for name, each in factors.items()},
            )
    return drafts


def _likely_id(pattern: str, drafts: list[Draft], problems: Problems) -> str:
    ids = [draft.id for draft in drafts[:MAX_COMPARED]]
    meant = problems.nearest(pattern, ids)
    if meant.startswith("did") or not ids:
        return meant
    return "ids are like " + ", ".join(ids[:3])


def _check_ids(drafts: list[Draft]) -> None:
    """Add a problem for each entry with ids that another one has."""
    first: dict[str, Draft] = {}
    repeated: dict[tuple[Place, Place], list[str]] = {}
    for draft in drafts:
        earlier = first.setdefault(draft.id, draft)
        if earlier is not draft:
            repeated.setdefault((draft.place, earlier.place), []).append(draft.id)
    for (place, taken), ids in islice(repeated.items(), MAX_REPORTED):
        by = taken.key if taken.source == place.source else f"{taken.source}: {taken.key}"
        more = f" and {len(ids) - 1} more are" if len(ids) > 1 else " is"
        place.child("id").fail(f"'{ids[0]}'{more} taken already, by {by}")
    if len(repeated) > MAX_REPORTED:
        place.fail(f"and {len(repeated) - MAX_REPORTED} more entries whose ids are taken already")


def _check_joints(drafts: list[Draft], joints: tuple[Joint, ...]) -> None:
    names = {joint.name for joint in joints}
    reported = set()
    for draft in drafts:
        where = (draft.place.source, draft.place.key.partition(" ")[0])
        if draft.joint and draft.joint not in names and where not in reported:
            reported.add(where)
            at = draft.place.child("joint")
            at.unknown(f"no joint '{draft.joint}'", draft.joint, names)


def _warn_of_units(placements: Sequence[Placement], joints: Sequence[Joint], place: Place) -> None:
    """Warn of a root or joint that is farther from the others than any animal has it."""
    if not placements:
        return
    roots = np.array([each.position for each in placements])
    names = [f"'{each.id}'" for each in placements] + [f"joint '{each.name}'" for each in joints]
    places = np.concatenate([roots, *([each.position] for each in joints)])
    away = np.linalg.norm(places - np.quantile(roots, 0.5, axis=0), axis=1)
    worst, longest = int(np.argmax(away)), max(each.kind.length for each in placements)
    if away[worst] > _MAX_SPREAD * longest:
        warn_input(
            f"{place.source}: {names[worst]} is {away[worst]:.3g} m from the middle of the roots,"
            f" and the longest feather has {longest:.3g} m. Positions are in metres unless [space]"
            " says otherwise"
        )


def _drawn(spread: dict[str, Any], drafts: list[Draft]) -> Array:
    """(n, 10) draws of all feathers, of length, width, camber, roll, and of _MATTER; but for length
    and roll few different ones where asked for."""
    names = [draft.id for draft in drafts]
    own = draws(spread["seed"], names)
    if spread["variants"]:
        names = [
            f"{draft.region}/{draft.choice.names}/{variant_number(draft.id, spread['variants'])}"
            for draft in drafts
        ]
        own[:, 1:3] = draws(spread["seed"], names)[:, 1:3]
    matter, bulk = (draws(spread["seed"], [name + end for name in names]) for end in _DRAWS)
    return np.concatenate([own, matter, bulk[:, :2]], axis=1)


def _patterns(name: str, kind: FeatherKind) -> tuple[int, int]:
    """Choose the splits of the leading and the trailing vane by the id of a feather."""
    leading, trailing = (
        variant_number(f"{name}/splits", each.splits.variants) if each.splits.count else 0
        for each in (kind.leading, kind.trailing)
    )
    return leading, trailing


def _placements(spread: Any, drafts: list[Draft], store: KindStore) -> tuple[Placement, ...]:
    """spread: checked [variation], or None."""
    if not drafts:
        return ()
    changes = np.zeros((len(drafts), 10))
    if spread is not None and spread is not INVALID:
        sizes = [spread[name] for name in ("length", "width", "camber", "roll", *_MATTER)]
        changes = _drawn(spread, drafts) * sizes
    sign = np.array([-1.0 if draft.left else 1.0 for draft in drafts])
    roll = sign * (np.array([draft.roll for draft in drafts]) + changes[:, 3])
    rotations = np.stack([draft.rotation for draft in drafts]) @ about_x(roll)
    placements = []
    for draft, rotation, change in zip(drafts, rotations, changes.tolist(), strict=True):
        with draft.place.problems.collecting():
            placements.append(_placement(draft, rotation, change, store))
    return tuple(placements)


def _placement(draft: Draft, rotation: Array, change: list[float], store: KindStore) -> Placement:
    """change: drawn of a feather, of each column of _drawn. Raises InputError."""
    kind = store.kind(draft.choice)
    factor, drawn = 1.0, Change()
    if draft.shape is not None:
        from featherfx.groom.read.drawn import drawn_changes

        factor, drawn = drawn_changes(draft, kind, store)
    scale = draft.scale * factor * (1.0 + change[0])
    shape = drawn._replace(
        width=draft.width * (1.0 + change[1]),
        camber=drawn.camber + draft.curl + change[2],
        hollow=draft.hollow,
        wrap=draft.wrap,
        stiffness=draft.stiffness * (1.0 + change[8]),
        weight=draft.weight * (1.0 + change[9]),
        patterns=_patterns(draft.id, kind),
        angle=change[4],
        across=1.0 + change[5],
        along=1.0 + change[6],
        thickness=1.0 + change[7],
    )
    prototype = store.adjusted(kind, shape)
    return Placement(
        id=draft.id,
        kind=store.adjusted(prototype, Change(scale=scale)),
        region=draft.region,
        position=draft.position,
        rotation=rotation,
        joint=draft.joint,
        mirrored=draft.left,
        skin=draft.skin,
        skin_uv=draft.skin_uv,
        prototype=prototype,
        size=scale,
        grown=draft.grown,
        turning=draft.turning,
    )
