"""Colours of feathers between parts of a bird: where two pass into each other, so do their colours.

A feather that stands where regions overlap has the mean of their bases and pigments by how much of
each there is, as it has their mean length; patterns stay those of its own region. A skin that is
painted has the last word on both.
"""

from __future__ import annotations

import fnmatch
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from featherfx.groom.keys.problems import Place
from featherfx.groom.looks import PIGMENTS, VANE_COLOUR, displayed
from featherfx.groom.presets.kind_store import KindStore
from featherfx.groom.read.drafts import Draft

_STEPS = 64  # of a painted colour
_MIXED = ("base", *PIGMENTS)


def shaded(
    colours: Mapping[str, dict[str, Any]], drafts: list[Draft], place: Place, store: KindStore
) -> list[Draft]:
    """The drafts, those between regions with the mean of their colours.

    colours: overrides by patterns of ids, of which the colours of other regions are found as their
    own feathers would have them.
    """
    numbers: dict[tuple[tuple[str, float], ...], int] = {}
    shades = {draft.region: _shade(colours, draft.id) for draft in drafts}
    result = []
    for draft in drafts:
        mixed = any(region != draft.region for region, _ in draft.mixture)
        if mixed and draft.mixture not in numbers:
            numbers[draft.mixture] = store.shade(_mean(shades, draft.mixture), place)
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
                numbers[base] = store.shade({"base": base} | dict.fromkeys(PIGMENTS, 0.0), place)
            changes = (*draft.choice.changes, numbers[base])
            draft = replace(draft, choice=replace(draft.choice, changes=changes))
        result.append(draft)
    return result


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
    """Base colour and pigments of a feather by its id."""
    found: dict[str, Any] = {}
    for pattern, change in colours.items():
        if fnmatch.fnmatchcase(name, pattern):
            found |= {key: each for key, each in change["colour"].items() if key in _MIXED}
    return found
