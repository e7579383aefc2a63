"""What the experiments of `featherfx lab` share: options and output."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any, TypeVar

import click

Decorated = TypeVar("Decorated", bound=Callable[..., Any])


class Vector(click.ParamType):
    """X,Y,Z."""

    name = "X,Y,Z"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[float, float, float]:
        if isinstance(value, tuple):
            return value
        try:
            x, y, z = (float(each) for each in value.split(","))
        except ValueError:
            self.fail(f"'{value}' is not three numbers such as 0,0,-1.5", param, ctx)
        return x, y, z


def options(*chosen: Callable[[Decorated], Decorated]) -> Callable[[Decorated], Decorated]:
    """One decorator from many."""

    def decorate(command: Decorated) -> Decorated:
        for option in reversed(chosen):
            command = option(command)
        return command

    return decorate


json_option = click.option(
    "--json", "as_json", is_flag=True, help="One JSON object on the output, SI units."
)


def show(values: dict[str, Any], as_json: bool) -> None:
    """One JSON object, or a table: numbers beside their names, lists in lines below them."""
    if as_json:
        click.echo(json.dumps(values))
        return
    for name, value in values.items():
        if not isinstance(value, list):
            click.echo(f"{name:20} {value:.6g}")
        elif value and not isinstance(value[0], list):
            click.echo(f"{name:20} " + "  ".join(f"{each:.6g}" for each in value))
        else:
            click.echo(f"{name} ({len(value)})")
            for row in value:
                click.echo("  " + "  ".join(f"{each:12.6g}" for each in _flat(row)))


def _flat(row: list[Any]) -> list[float]:
    return [each for part in row for each in (_flat(part) if isinstance(part, list) else [part])]
