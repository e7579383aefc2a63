"""Presets by name, and kinds made of a preset and changes: equal feathers share one object."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from featherfx.errors import InputError, Problem, all_of, require_type
from featherfx.groom.document import merge_tables
from featherfx.groom.keys.preset import PRESET_FAMILIES, Quality
from featherfx.groom.keys.problems import Place, Problems, nearest
from featherfx.groom.materials import Pattern
from featherfx.groom.presets.kinds import Change, adjusted, blended, kind_of
from featherfx.groom.presets.library import Library, Sourced, Tree, plain
from featherfx.groom.types import FeatherKind


@dataclass(frozen=True)
class KindChoice:
    """Presets and overrides that make a feather's kind, before scaling.

    names: one feather preset, or two that are blended. blend: 0 the first, 1 the second.
    changes: numbers of changes registered with the store, applied in order.
    place: where the choice was made, for problems.
    """

    names: tuple[str, ...]
    blend: float
    changes: tuple[int, ...]
    place: Place


class KindStore:
    """Builds kinds, each once."""

    def __init__(self, library: Library) -> None:
        self._library = library
        self._changes: list[tuple[Tree, Place]] = []
        self._shades: dict[int, Tree] = {}
        self._marks: dict[Pattern, int] = {}
        self._kinds: dict[Any, FeatherKind | InputError] = {}
        self._adjusted: dict[Any, FeatherKind] = {}

    def change(self, tree: Tree, place: Place) -> int:
        """Registers a change to kinds; its number goes into KindChoice.changes."""
        self._changes.append((tree, place))
        return len(self._changes) - 1

    def shade(self, shade: dict[str, Any], place: Place) -> int:
        """Registers keys of a colour that leave the rest of a kind's colour as it is."""
        number = self.change({}, place)
        self._shades[number] = {name: Sourced(each, place.source) for name, each in shade.items()}
        return number

    def mark(self, pattern: Pattern, place: Place) -> int:
        """Registers a mark over all others of a kind; equal ones have one number."""
        if pattern not in self._marks:
            self._marks[pattern] = self.change({}, place)
        return self._marks[pattern]

    def kind(self, choice: KindChoice) -> FeatherKind:
        """The chosen kind. Raises InputError."""
        good = (choice.names, choice.blend, choice.changes)
        bad = (good, choice.place.key)
        found = self._kinds.get(good) or self._kinds.get(bad)
        if found is None:
            try:
                found = self._kinds[good] = self._build(choice)
            except InputError as error:
                found = self._kinds[bad] = error
        if isinstance(found, InputError):
            raise InputError(*found.problems)
        return found

    def _build(self, choice: KindChoice) -> FeatherKind:
        if len(choice.names) == 1:
            return self._preset(choice.names[0], choice.changes, choice.place)
        single = (KindChoice((each,), 0.0, choice.changes, choice.place) for each in choice.names)
        ends = all_of(*(partial(self.kind, each) for each in single))
        try:
            return blended(ends[0], ends[1], choice.blend)
        except ValueError:
            both = " and ".join(f"'{name}'" for name in choice.names)
            told = "cannot be blended: their outlines or guides differ in number"
            choice.place.child("blend").refuse(f"{both} {told}")

    def _preset(self, name: str, changes: tuple[int, ...], place: Place) -> FeatherKind:
        library = self._library
        base = {"base": Sourced(name, place.source)}
        tree = library.resolve("feather", base, place, key="kind")
        at = place
        for number in changes:
            above, at = self._changes[number]
            tree = merge_tables(tree, above)
            if number in self._shades:
                tree["colour"] = {**tree.get("colour", {}), **self._shades[number]}
        kind = kind_of(name, library.finish("feather", tree, at), at)
        marks = tuple(mark for mark, number in self._marks.items() if number in changes)
        colour = replace(kind.colour, patterns=kind.colour.patterns + marks)
        return replace(kind, colour=colour) if marks else kind

    def adjusted(self, kind: FeatherKind, change: Change) -> FeatherKind:
        """The kind with a change; one object for equal requests."""
        if change == Change():
            return kind
        key = (id(kind), change)
        if key not in self._adjusted:
            self._adjusted[key] = adjusted(kind, change)
        return self._adjusted[key]


def _named(name: str, library: Library) -> tuple[str, str]:
    """Family and name of "swan_vane" or "material/vane/swan_vane"; raises InputError."""
    family, _, short = name.rpartition("/")
    families = (
        [family] if family in PRESET_FAMILIES else list(PRESET_FAMILIES) if not family else []
    )
    hits = [each for each in families if library.find(each, short)]
    if len(hits) == 1:
        return hits[0], short
    if hits:
        fault = f"is in several families. Give {' or '.join(f'{each}/{short}' for each in hits)}"
    elif not families:
        fault = f"there is no family '{family}', {nearest(family, PRESET_FAMILIES)}"
    else:
        known = {each for one in families for each in library.names(one)}
        fault = f"there is no such preset, {nearest(short, known)}"
    raise InputError(Problem("presets", name, fault))


def load_preset(name: str, preset_folders: Iterable[str | Path] = ()) -> tuple[str, Tree]:
    """Family and merged tree (leaves are Sourced) of a preset; raises InputError."""
    library = Library(preset_folders, Problems())
    family, short = _named(name, library)
    place = Place("presets", f"{family}/{short}", library.problems)
    return family, library.merged(family, {"base": Sourced(short, "presets")}, place)


def read_quality(name: str, preset_folders: Iterable[str | Path] = ()) -> Quality:
    """A quality preset by its name. Raises InputError."""
    require_type("name", name, str, "the name of a quality preset")
    _, tree = load_preset(f"quality/{name}", preset_folders)
    return Quality(name=name, **plain(tree))


def check_preset(family: str, path: Path, library: Library) -> None:
    """Checks one preset file with all that it names. Raises InputError."""
    place = Place(library.label(path), "", library.problems)
    finished = library.finish(family, library.load_file(family, path), place)
    if family == "feather":
        kind_of(path.stem, finished, place)
