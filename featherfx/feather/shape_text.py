"""Shapes of feathers as text, for files that feathers are built from again."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, fields, is_dataclass, replace
from functools import lru_cache
from typing import Any, get_args, get_origin, get_type_hints

from featherfx.groom.types import Colour, FeatherKind

_MIRRORED = "mirrored"


@lru_cache(maxsize=4096)
def shape_text(kind: FeatherKind, mirrored: bool) -> str:
    """All that a feather is built from but its colours, to the last bit."""
    told = asdict(replace(kind, colour=Colour())) | {_MIRRORED: mirrored}
    del told["colour"]
    return json.dumps(told, separators=(",", ":"), allow_nan=False)


def shape_of(text: str) -> tuple[FeatherKind, bool]:
    """The kind that a text is of, and whether it is mirrored. Raises ValueError for other texts."""
    try:
        told = json.loads(text)
        mirrored = told.pop(_MIRRORED)
        if isinstance(mirrored, bool):
            return _read(FeatherKind, told), mirrored
    except (AttributeError, KeyError, TypeError, RecursionError) as error:
        raise ValueError(f"is no shape of a feather: {error}") from error
    raise ValueError("is no shape of a feather")


def _read(kind: Any, value: Any) -> Any:
    """A value of a declared type. Raises ValueError or TypeError for one of another."""
    if isinstance(kind, type) and is_dataclass(kind) and isinstance(value, Mapping):
        hints = get_type_hints(kind)
        known = {each.name for each in fields(kind)}
        if not value.keys() <= known:
            raise ValueError(f"holds {min(value.keys() - known)}")
        return kind(**{name: _read(hints[name], each) for name, each in value.items()})
    if get_origin(kind) is tuple and isinstance(value, list):
        items = get_args(kind)
        each = items[:1] * len(value) if items[-1:] == (Ellipsis,) else items
        return tuple(_read(*pair) for pair in zip(each, value, strict=True))
    if kind is float and isinstance(value, int | float) and not isinstance(value, bool):
        return float(value)
    if isinstance(kind, type) and type(value) is kind:
        return value
    raise ValueError(f"holds {value!r:.40}")
