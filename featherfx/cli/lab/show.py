"""Results of experiments as one JSON object or as a table."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import fields, is_dataclass
from math import isfinite
from typing import Any

import click


def show(result: Any, as_json: bool) -> None:
    """A dataclass or mapping; names beside values, lists of lists in lines below their name."""
    values = plain(result)
    if as_json:
        click.echo(json.dumps(values))
        return
    for line in _lines(values, ""):
        click.echo(line)


def plain(result: Any) -> Any:
    """Only what JSON has: a number that is not finite is null."""
    if hasattr(result, "as_json"):
        result = result.as_json()
    if is_dataclass(result):
        result = {each.name: getattr(result, each.name) for each in fields(result)}
    if hasattr(result, "_asdict"):
        result = result._asdict()
    if hasattr(result, "tolist"):
        result = result.tolist()
    if isinstance(result, Mapping):
        return {name: plain(each) for name, each in result.items()}
    if isinstance(result, list | tuple):
        return [plain(each) for each in result]
    return None if isinstance(result, float) and not isfinite(result) else result


def _lines(values: dict[str, Any], before: str) -> Iterator[str]:
    """Tables in tables by dotted names."""
    for key, value in values.items():
        name = f"{before}{key}"
        if isinstance(value, dict):
            yield from _lines(value, f"{name}.")
        elif isinstance(value, list) and value and isinstance(value[0], dict):
            yield name
            for row in value:
                yield "  " + "  ".join(f"{k} {_text(v)}" for k, v in row.items())
        elif isinstance(value, list) and value and isinstance(value[0], list):
            yield f"{name} ({len(value)})"
            for row in value:
                yield "  " + "  ".join(f"{_text(each):>12}" for each in _flat(row))
        elif isinstance(value, list):
            yield f"{name:20} " + "  ".join(_text(each) for each in value)
        else:
            yield f"{name:20} {_text(value)}"


def _text(value: Any) -> str:
    if value is None:
        return "-"
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def _flat(row: list[Any]) -> list[Any]:
    return [each for part in row for each in (_flat(part) if isinstance(part, list) else [part])]
