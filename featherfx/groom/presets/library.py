"""Merging of presets, their `base` and overrides, each value with its source."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from featherfx.errors import InputError
from featherfx.files.folders import search_path, shipped_folder
from featherfx.groom.document import merge_tables
from featherfx.groom.keys.places import Preset
from featherfx.groom.keys.preset import PRESET_FAMILIES
from featherfx.groom.keys.problems import Place, Problems
from featherfx.groom.keys.values import REQUIRED, Key, Table, expected
from featherfx.groom.read.toml_file import load_toml, told
from featherfx.limits import MAX_BASES


@dataclass(frozen=True)
class Sourced:
    """A merged value. source: the file that it came from, or "default"."""

    value: Any
    source: str


Tree = dict[str, Any]  # nested tables whose leaves are Sourced


def sourced(table: dict[str, Any], source: str) -> Tree:
    """A checked table as a tree."""
    return {
        name: sourced(value, source) if isinstance(value, dict) else Sourced(value, source)
        for name, value in table.items()
    }


def plain(tree: Tree) -> dict[str, Any]:
    """A tree's values without their sources."""
    return {
        name: plain(value) if isinstance(value, dict) else value.value
        for name, value in tree.items()
    }


class Library:
    """Presets by family and name, each file read once.

    problems: of whoever reads with it. said: what the files say, by presets.FAMILY/NAME.KEY
    (toml_file.py).
    """

    def __init__(self, folders: Iterable[str | Path], problems: Problems) -> None:
        self.folders = search_path(folders)
        self.problems = problems
        self.said: dict[str, str] = {}
        self._loaded: dict[Path, Tree | InputError] = {}
        self._shipped = shipped_folder()

    def label(self, path: Path) -> str:
        """Return the name of a preset file in messages, for shipped ones without its folder."""
        if path.is_relative_to(self._shipped):
            return (Path("presets") / path.relative_to(self._shipped)).as_posix()
        return str(path)

    def names(self, family: str) -> set[str]:
        """Names of all presets of a family."""
        return {path.stem for folder in self.folders for path in (folder / family).glob("*.toml")}

    def find(self, family: str, name: str, start: int = 0) -> tuple[Path, int] | None:
        """The file of a preset and the number of its folder, from folder number start on."""
        if Path(name).name != name:
            return None
        for index, folder in enumerate(self.folders[start:], start):
            path = folder / family / f"{name}.toml"
            if path.is_file():
                return path, index
        return None

    def resolve(
        self,
        family: str,
        tree: Tree,
        place: Place,
        chain: Sequence[tuple[str, Path]] = (),
        key: str = "base",
    ) -> Tree:
        """The tree with its `base` merged under it. Raises InputError.

        chain: (name, file) of the presets that led here, to see cycles.
        key: what the user wrote the base under.
        """
        rest = {name: value for name, value in tree.items() if name != "base"}
        base = tree.get("base")
        below = {} if base is None else self._load(family, base, place.child(key), chain)
        return merge_tables(below, rest)

    def _load(
        self, family: str, base: Sourced, place: Place, chain: Sequence[tuple[str, Path]]
    ) -> Tree:
        name = base.value
        start = 0
        if chain and chain[-1][0] == name:  # a preset over another of its own name
            start = 1 + self._folder_number(chain[-1][1], family)
        found = self.find(family, name, start)
        where = Place(base.source, place.key, self.problems)
        if found is None and start:
            where.refuse(f"preset cycle: {name} -> {name}. Give it another base")
        if found is None:
            where.refuse(where.meant(f"no {family} preset '{name}'", name, self.names(family)))
        path = found[0]
        if len(chain) >= MAX_BASES:
            where.refuse(f"more than {MAX_BASES} presets extend each other. Merge some of them")
        if any(path == each for _, each in chain):
            names = [each for each, _ in chain]
            loop = [*names[[p for _, p in chain].index(path) :], name]
            where.refuse(f"preset cycle: {' -> '.join(loop)}. Give one of them another base")
        return self.load_file(family, path, chain)

    def _folder_number(self, path: Path, family: str) -> int:
        for index, folder in enumerate(self.folders):
            if path.parent == folder / family:
                return index
        return -1

    def load_file(self, family: str, path: Path, chain: Sequence[tuple[str, Path]] = ()) -> Tree:
        """A preset file with all its bases. Raises InputError."""
        if path not in self._loaded:
            try:
                self._loaded[path] = self._read(family, path, chain)
            except InputError as error:
                self._loaded[path] = error
        found = self._loaded[path]
        if isinstance(found, InputError):
            raise InputError(*found.problems)
        return found

    def _read(self, family: str, path: Path, chain: Sequence[tuple[str, Path]]) -> Tree:
        source = self.label(path)
        raw, problems = load_toml(path, source), Problems()
        name = f"presets.{family}/{path.stem}" + " (below)" * bool(
            chain and chain[-1][0] == path.stem
        )
        self.said |= {f"{name}.{key}": text for key, text in told(raw, path.parent).items()}
        checked = PRESET_FAMILIES[family].extended.check(raw, Place(source, "", problems), True)
        tree, base = Tree(), raw.get("base")
        if isinstance(checked, dict) and not len(problems):
            tree = sourced(checked, source)
        elif isinstance(base, str):
            tree = {"base": Sourced(base, source)}  # still reports what is wrong below
        with problems.collecting():
            place = Place(source, "", self.problems)
            tree = self.resolve(family, tree, place, (*chain, (path.stem, path)))
        problems.hand_on()
        return tree

    def finish(self, family: str, tree: Tree, place: Place) -> Tree:
        """The tree with materials resolved and defaults filled in. Raises InputError."""
        preset, kind = PRESET_FAMILIES[family], tree.get("kind")
        if preset.kinds and not isinstance(kind, Sourced):
            told = f"missing, expects one of {', '.join(preset.kinds)}, unless a base is given"
            place.child("kind").refuse(told)
        table = preset.finished(kind.value if isinstance(kind, Sourced) else "")
        return self._finish(table, tree, place)

    def _finish(self, table: Table, tree: Tree, place: Place) -> Tree:
        result, problems = Tree(), Problems()
        for name, value in tree.items():
            if name not in table.keys:
                source = value.source if isinstance(value, Sourced) else place.source
                message = f"does not apply to a {table.title}"
                known = problems.nearest(name, table.keys)
                problems.add(source, place.child(name).key, f"{message}, {known}")
        for name, key in table.keys.items():
            with problems.collecting():
                result[name] = self._finish_key(key, tree.get(name), place.child(name))
        problems.hand_on()
        return result

    def _finish_key(self, key: Key, value: Any, place: Place) -> Any:
        if isinstance(key.type, Preset) and value is not None:
            return self.merged(key.type.family, value, place)
        if isinstance(key.type, Table) and (value is not None or key.default is not None):
            return self._finish(key.type, value or {}, place)
        if value is not None:
            return value
        if key.default is REQUIRED:
            place.refuse(f"missing, expects {expected(key.type)}")
        return Sourced(key.default, "default")

    def merged(self, family: str, tree: Tree, place: Place, key: str = "base") -> Tree:
        """resolve() and finish() in one."""
        return self.finish(family, self.resolve(family, tree, place, key=key), place)
