"""Kinds by preset and changes: equal feathers share one FeatherKind object."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from featherfx.groom.keys.values import Place
from featherfx.groom.presets.kinds import Change, adjusted, blended, kind_of
from featherfx.groom.presets.library import Library, Sourced, Tree, merged
from featherfx.groom.types import FeatherKind


@dataclass(frozen=True)
class KindChoice:
    """What a feather is made of before scaling.

    names: one feather preset, or two that are blended. blend: 0 the first, 1 the second.
    changes: numbers of changes registered with the store, applied in order.
    place: where the choice was made, for problems.
    """

    names: tuple[str, ...]
    blend: float
    changes: tuple[int, ...]
    place: Place


class KindStore:
    """Builds kinds, each once. Problems go to the library's list."""

    def __init__(self, library: Library) -> None:
        self._library = library
        self._changes: list[tuple[Tree, Place]] = []
        self._kinds: dict[Any, FeatherKind | None] = {}
        self._adjusted: dict[Any, FeatherKind] = {}

    def change(self, tree: Tree, place: Place) -> int:
        """Registers a change to kinds; its number goes into KindChoice.changes."""
        self._changes.append((tree, place))
        return len(self._changes) - 1

    def kind(self, choice: KindChoice) -> FeatherKind | None:
        """The chosen kind; None after adding problems (once for each place)."""
        good = (choice.names, choice.blend, choice.changes)
        if good in self._kinds:
            return self._kinds[good]
        bad = (good, choice.place.key)
        if bad in self._kinds:
            return None
        built = self._build(choice)
        self._kinds[bad if built is None else good] = built
        return built

    def _build(self, choice: KindChoice) -> FeatherKind | None:
        if len(choice.names) == 1:
            return self._preset(choice.names[0], choice.changes, choice.place)
        ends = [
            self.kind(KindChoice((name,), 0.0, choice.changes, choice.place))
            for name in choice.names
        ]
        if ends[0] is None or ends[1] is None:
            return None
        try:
            kind: FeatherKind = blended(ends[0], ends[1], choice.blend)
        except ValueError:
            first, second = choice.names
            choice.place.child("blend").fail(
                f"'{first}' and '{second}' cannot be blended: their outlines or guides differ in "
                "number"
            )
            return None
        return kind

    def _preset(self, name: str, changes: tuple[int, ...], place: Place) -> FeatherKind | None:
        library = self._library
        base = {"base": Sourced(name, place.source)}
        tree = library.resolve("feather", base, place, key="kind")
        at = place
        for number in changes:
            above, at = self._changes[number]
            tree = None if tree is None else merged(tree, above)
        finished = None if tree is None else library.finish("feather", tree, at)
        return None if finished is None else kind_of(name, finished, at)

    def adjusted(self, kind: FeatherKind, change: Change) -> FeatherKind:
        """The kind with a change; one object for equal requests."""
        if change == Change():
            return kind
        key = (id(kind), change)
        if key not in self._adjusted:
            self._adjusted[key] = adjusted(kind, change)
        return self._adjusted[key]
