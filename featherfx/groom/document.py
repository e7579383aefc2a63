"""Documents: the tables that a groom or shot was read from, to be changed and saved again."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from copy import deepcopy
from dataclasses import dataclass, fields, replace
from importlib import import_module
from pathlib import Path
from typing import Any, ClassVar, Self

import numpy as np

from featherfx.errors import InputError, Problem, require_type
from featherfx.files.folders import folders_of
from featherfx.phases import StageRead

# source of tables that no file holds
_IN_MEMORY = "<memory>"
_UDIM = "<UDIM>"


@dataclass(frozen=True)
class Document:
    """Tables as TOML has them, and what their reading needs.

    kind: "groom" or "shot". tables: names to values of TOML's types. source: file that messages
    name; files that the tables name are seen from its folder. preset_folders: searched before the
    user's and the shipped presets. files, reads: scenes that were read, and what of them.
    """

    kind: str
    tables: Mapping[str, Any]
    source: Path
    preset_folders: tuple[str | Path, ...] = ()
    files: tuple[Path, ...] = ()
    reads: tuple[StageRead, ...] = ()

    def read(self) -> Any:
        """Return the groom or shot of the tables. Raises InputError with all their problems."""
        # what reads stands above what is read
        return import_module("featherfx.api").read_document(self)

    def with_tables(self, tables: Mapping[str, Any]) -> Document:
        """Return it with some top-level keys of other values; None: without the key."""
        found = {
            **self.tables,
            **{str(key): self._plain(str(key), each) for key, each in tables.items()},
        }
        return replace(self, tables={key: each for key, each in found.items() if each is not None})

    def with_overrides(self, changes: Mapping[str, Mapping[str, Any]]) -> Document:
        """Return it with [overrides] that come after its own. Keys of changes may be dotted."""
        require_type("changes", changes, Mapping, '{"PATTERN": {"KEY": VALUE}}')
        found = dict(self.tables.get("overrides", {}))
        for pattern, values in changes.items():
            require_type(f"changes[{pattern!r}]", values, Mapping, "a dict of keys and values")
            found[pattern] = merge_tables(found.pop(pattern, {}), _nested(values))
        return self.with_tables({"overrides": found})

    def seen_from(self, folder: Path) -> dict[str, Any]:
        """Return the tables with files named as they are seen from another folder."""
        own, other = self.source.absolute().parent, folder.absolute()

        def moved(value: Any) -> Any:
            if isinstance(value, dict):
                return {key: moved(each) for key, each in value.items()}
            if isinstance(value, list):
                return [moved(each) for each in value]
            if isinstance(value, str) and own != other and _is_file(own, value):
                return Path(os.path.relpath(own / value, other)).as_posix()
            return value

        return {key: moved(each) for key, each in self.tables.items()}

    def _plain(self, key: str, value: Any) -> Any:
        """Return a value in TOML's types. Raises InputError for one that TOML cannot hold."""
        if isinstance(value, Documented):
            if key != value.document_kind:
                told = f"{value!r} is a {value.document_kind}. Give what `{key}` of a file holds"
                raise InputError(Problem(str(self.source), key, told))
            return value.written_document().seen_from(self.source.parent)
        if isinstance(value, Mapping):
            found = {name: self._plain(f"{key}.{name}", each) for name, each in value.items()}
            return {str(name): each for name, each in found.items() if each is not None}
        if isinstance(value, np.ndarray | np.generic):
            return value.tolist()
        if isinstance(value, list | tuple):
            return [self._plain(f"{key}[{index}]", each) for index, each in enumerate(value)]
        if isinstance(value, os.PathLike):
            return os.fspath(value)
        if value is None or isinstance(value, bool | int | float | str):
            return value
        message = f"type {type(value).__name__} is nothing that TOML can hold. Give another value"
        raise InputError(Problem(str(self.source), key, message))


class Documented:
    """Grooms and shots: each may be made of tables, changed and saved.

    Nothing changes in place. Of an object whose fields were replaced one by one, by
    `dataclasses.replace`, no document is known; these methods refuse it.
    """

    document_kind: ClassVar[str]
    document: Document | None

    @classmethod
    def from_dict(
        cls,
        tables: Mapping[str, Any],
        folder: str | Path = ".",
        preset_folders: Iterable[str | Path] = (),
    ) -> Self:
        """Read tables as a TOML file has them; arrays, tuples, paths and grooms are allowed.

        folder: from which the names of files are seen. Raises InputError with all problems.
        """
        require_type("tables", tables, Mapping, "a dict of the keys of the file")
        folders = folders_of(preset_folders)
        empty = Document(cls.document_kind, {}, Path(folder) / _IN_MEMORY, folders)
        found: Self = empty.with_tables(tables).read()
        return found

    def replace(self, **tables: Any) -> Self:
        """Return it with some keys of its file of other values, read anew; None: without a key.

        Raises InputError with all problems.
        """
        found: Self = self.written_document().with_tables(tables).read()
        return found

    def with_overrides(self, changes: Mapping[str, Mapping[str, Any]]) -> Self:
        """Return it with keys of feather presets changed, by patterns of ids.

        changes: as [overrides]; keys may be dotted, and `rachis.` and `vane.` reach their
        materials, too. Raises InputError with all problems.
        """
        found: Self = self.written_document().with_overrides(changes).read()
        return found

    def to_dict(self) -> dict[str, Any]:
        """Return a copy of its tables. Raises InputError where its fields were replaced."""
        return deepcopy(dict(self.written_document().tables))

    def to_toml(self, path: str | Path, overwrite: bool = False) -> Path:
        """Save its tables, without comments; files are named as seen from there.

        Raises InputError where the file exists and may not be overwritten, or cannot be written.
        """
        from featherfx.groom.read.toml_text import save_toml

        require_type("path", path, str | Path, "the path of a file that ends in .toml")
        target, document = Path(path), self.written_document()
        save_toml(document.seen_from(target.parent), target, overwrite)
        return target

    def written_document(self) -> Document:
        """Return its document. Raises InputError where its fields were replaced one by one."""
        if self.document is None:
            name = getattr(self, "name", self.document_kind)
            told = "is not as its tables say: fields were replaced. Use its method replace()"
            raise InputError(Problem(str(name), "", told))
        return self.document

    def documented(self, document: Document) -> Self:
        """Return it with its document."""
        found = replace(self)  # type: ignore[type-var]
        object.__setattr__(found, "document", document)
        return found


def _nested(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return dotted keys as tables."""
    # materials of the parts of a feather
    from featherfx.groom.materials import RachisMaterial, VaneMaterial

    materials: dict[str, Any] = {"rachis": RachisMaterial, "vane": VaneMaterial}
    found: dict[str, Any] = {}
    for key, value in values.items():
        part, _, name = key.partition(".")
        if part in materials and name in {each.name for each in fields(materials[part])}:
            part = f"{part}_material"
        if name:
            value = _nested({name: value})
        elif isinstance(value, Mapping):
            value = dict(value)
        found = merge_tables(found, {part: value})
    return found


def merge_tables(below: Mapping[str, Any], above: Mapping[str, Any]) -> dict[str, Any]:
    """Return tables over others. One that names a `base` replaces what lies below it."""
    result = dict(below)
    for name, value in above.items():
        under = below.get(name)
        if isinstance(value, dict) and isinstance(under, dict) and "base" not in value:
            value = merge_tables(under, value)
        result[name] = value
    return result


def _is_file(folder: Path, name: str) -> bool:
    """Return True if a value names files that are seen from a folder."""
    if "." not in name or Path(name).is_absolute():
        return False
    try:
        if _UDIM in name:
            return any(folder.glob(name.replace(_UDIM, "[0-9][0-9][0-9][0-9]")))
        return (folder / name).is_file()
    except (OSError, ValueError, NotImplementedError):
        return False
