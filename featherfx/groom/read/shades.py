"""Colours of feathers between parts of a bird: where two pass into each other, so do their colours.

A feather that stands where regions overlap has the mean of their base colours by how much of each
there is, as it has their mean length; patterns stay those of its own region. A skin that is painted
has the last word on both.
"""

from __future__ import annotations

import fnmatch
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from featherfx.groom.keys.problems import Place
from featherfx.groom.presets.kind_store import KindStore
from featherfx.groom.read.drafts import Draft

_STEPS = 64  # of a painted colour


def shaded(
    colours: Mapping[str, dict[str, Any]], drafts: list[Draft], place: Place, store: KindStore
) -> list[Draft]:
    """The drafts, those between regions with the mean of their colours.

    colours: overrides by patterns of ids, of which the colours of other regions are found as their
    own feathers would have them.
    """
    numbers: dict[tuple[tuple[str, float], ...], int] = {}
    bases = {draft.region: _base(colours, draft.id) for draft in drafts}
    result = []
    for draft in drafts:
        mixed = any(region != draft.region for region, _ in draft.mixture)
        if mixed and draft.mixture not in numbers:
            base = _mean(bases, draft.mixture)
            numbers[draft.mixture] = store.shade(base, place) if base else store.change({}, place)
        if mixed:
            changes = (*draft.choice.changes, numbers[draft.mixture])
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
                numbers[base] = store.shade(base, place)
            changes = (*draft.choice.changes, numbers[base])
            draft = replace(draft, choice=replace(draft.choice, changes=changes))
        result.append(draft)
    return result


def _mean(
    bases: Mapping[str, tuple[float, ...] | None], mixture: tuple[tuple[str, float], ...]
) -> tuple[float, ...]:
    """sRGB; empty where a region has no colour."""
    known = [(bases.get(region), part) for region, part in mixture]
    if any(base is None for base, _ in known):
        return ()
    mean = sum(part * np.array(base) for base, part in known)
    return tuple(np.round(mean, 4).tolist())


def _base(colours: Mapping[str, dict[str, Any]], name: str) -> tuple[float, ...] | None:
    """Base colour of a feather by its id."""
    found = None
    for pattern, change in colours.items():
        if fnmatch.fnmatchcase(name, pattern):
            found = change["colour"].get("base", found)
    return found
