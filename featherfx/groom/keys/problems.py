"""Problems of an input: their places, and one list for all of them."""

from __future__ import annotations

import difflib
from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, fields
from importlib import import_module
from typing import Any, NoReturn

from featherfx.errors import InputError, Problem
from featherfx.limits import MAX_COMPARED, MAX_LISTED, MAX_SEARCHES

# what a check gives for a value that is wrong
INVALID = object()
# problems of one kind that a file reports; a table of nonsense stays readable
MAX_REPORTED = 20
# known names that are all listed, and those that are where there are more
_MAX_KNOWN, _FEW = 24, 5
_ALIKE = 0.63  # least share of two names that is common, for one to be meant by the other
_SHORT = 5  # characters; others must be nearly as long
_LONGEST_COMPARED = 200  # characters; comparing takes their square


class Problems:
    """Collects problems in the order in which they are found, each once.

    file_keys: keys that the file lacks, which a table may have swallowed. groom_keys: those of the
    groom that a shot names.
    """

    def __init__(self) -> None:
        self.file_keys: Collection[str] = ()
        self.groom_keys: Collection[str] = ()
        self._found: dict[Problem, None] = {}
        self._searches = 0

    def add(self, source: object, key: str, message: str) -> None:
        self._found[Problem(str(source), key, message)] = None

    @contextmanager
    def collecting(self) -> Iterator[None]:
        """Add the problems of an InputError, and go on behind the block."""
        try:
            yield
        except InputError as error:
            self._found |= dict.fromkeys(error.problems)

    def __len__(self) -> int:
        return len(self._found)

    def listed(self) -> list[Problem]:
        """Return the first problems of every file; the others are counted."""
        counts: Counter[str] = Counter()
        listed = []
        for problem in self._found:
            counts[problem.source] += 1
            if counts[problem.source] <= MAX_LISTED:
                listed.append(problem)
        more = [
            Problem(source, "", f"and {count - MAX_LISTED} more problems")
            for source, count in counts.items()
            if count > MAX_LISTED
        ]
        return listed + more

    def raise_any(self) -> None:
        """Raises InputError with what was collected, as listed, if anything was."""
        if self._found:
            raise InputError(*self.listed())

    def hand_on(self) -> None:
        """As raise_any, with all of it, for who collects further."""
        if self._found:
            raise InputError(*self._found)

    def nearest(self, name: str, names: Iterable[str]) -> str:
        """nearest() for the first names that are wrong; empty when so many have been looked for."""
        return nearest(name, names) if self._may_search() else ""

    def closest(self, name: str, names: Sequence[str]) -> str:
        """The name most like another; empty for none, and when so many have been looked for."""
        return next(iter(closest(name, names, 1)), "") if self._may_search() else ""

    def _may_search(self) -> bool:
        self._searches += 1
        return self._searches <= MAX_SEARCHES


@dataclass(frozen=True)
class Place:
    """Place of a value: a file, a dotted key, and the list that takes its problems.

    around: keys of the table that holds this one, by name.
    """

    source: str
    key: str
    problems: Problems
    around: Mapping[str, Any] = field(default_factory=dict, compare=False)

    def child(self, name: str) -> Place:
        """The place of a key below this one (itself for an empty name)."""
        if not name:
            return self
        return Place(self.source, f"{self.key}.{name}" if self.key else name, self.problems)

    def item(self, index: int) -> Place:
        return Place(self.source, f"{self.key}[{index}]", self.problems)

    def fail(self, message: str) -> Any:
        self.problems.add(self.source, self.key, message)
        return INVALID

    def refuse(self, *messages: str) -> NoReturn:
        """Raise what is wrong, where nothing can go on; see Problems.collecting."""
        raise InputError(*(Problem(self.source, self.key, message) for message in messages))

    def unknown(self, message: str, name: str, names: Iterable[str]) -> Any:
        """fail() for a name that is none of the known ones, with the one that is likely meant."""
        return self.fail(self.meant(message, name, names))

    def unknown_key(
        self, names: Iterable[str], below: Sequence[str], near: Sequence[str] = ()
    ) -> Any:
        """fail() for a key that a table lacks.

        below, near: keys of its tables that have this name, and the name that is most like it.
        """
        name = self.key.rpartition(".")[2]
        if below:
            return self.fail(f"unknown key, did you mean {' or '.join(below)}?")
        if name == self.key and name in self.problems.groom_keys:
            return self.fail("is a key of grooms. Write it in the groom")
        if name == self.key and self.problems.groom_keys and name in _bake_options():
            option = _OPTIONS.get(name, name).replace("_", "-")
            return self.fail(f"is an option of commands. Write --{option} there")
        if "." in self.key and name in self.problems.file_keys:
            return self.fail("unknown key here. Write it above the first table of the file")
        if near and near[0].rpartition(".")[2] not in names:
            return self.fail(f"unknown key, did you mean {' or '.join(near)}?")
        return self.unknown("unknown key", name, names)

    def meant(self, message: str, name: str, names: Iterable[str]) -> str:
        """A message about a name that is none of the known ones, with the one likely meant."""
        near = self.problems.nearest(name, names)
        return f"{message}, {near}" if near else message


# options whose names in commands are other ones
_OPTIONS = {"preset_folders": "presets", "form": "as"}


def _bake_options() -> set[str]:
    """Return the names of options of bakes."""
    # what bakes stands above what is read
    return {each.name for each in fields(import_module("featherfx.baking.options").BakeOptions)}


def closest(name: str, names: Sequence[str], most: int) -> list[str]:
    """Names that are like one, the likest first; none where it is too long to compare."""
    if len(name) > _LONGEST_COMPARED:
        return []
    compared = [each for each in names[:MAX_COMPARED] if len(each) <= _LONGEST_COMPARED]
    short = [each for each in compared if "".join(part[:1] for part in each.split("_")) == name]
    if len(name) <= _SHORT:
        compared = [each for each in compared if abs(len(each) - len(name)) <= 1]
    return short[:most] or difflib.get_close_matches(name, compared, n=most, cutoff=_ALIKE)


def nearest(name: str, names: Iterable[str]) -> str:
    """Half a sentence that names the likeliest meant name, or all of them if they are few."""
    known = sorted(names)
    close = closest(name, known, 1)
    if close:
        return f"did you mean '{close[0]}'?"
    if not known:
        return "there are none"
    if len(known) <= _MAX_KNOWN:
        return f"known: {', '.join(known)}"
    if len(name) > _LONGEST_COMPARED:
        return f"there are {len(known)}"
    like = difflib.get_close_matches(name, known[:MAX_COMPARED], n=_FEW, cutoff=0.0)
    return f"nearest of {len(known)}: {', '.join(like)}"
