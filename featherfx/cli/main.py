"""The `featherfx` command. A command is imported when it is called, and imports its work then."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from importlib import import_module

import click

from featherfx._version import __version__
from featherfx.cli.program import Program, leave, use_utf8

# module of featherfx.cli that holds each command
_MODULES = {
    "bake": "bake",
    "bench": "bench",
    "check": "check",
    "completion": "install",
    "doctor": "install",
    "error": "stats",
    "export": "export",
    "groom": "export",
    "inspect": "check",
    "join": "farm",
    "lab": "lab.group",
    "plugins": "install",
    "presets": "presets",
    "preview": "preview",
    "retime": "export",
    "sample": "presets",
    "schema": "presets",
    "sculpt": "export",
    "stats": "stats",
    "trace": "presets",
    "tune": "view",
    "view": "view",
}


class _Commands(Mapping[str, click.Command]):
    """Commands by name, each imported when it is asked for."""

    def __getitem__(self, name: str) -> click.Command:
        command: click.Command = getattr(import_module(f"featherfx.cli.{_MODULES[name]}"), name)
        return command

    def __iter__(self) -> Iterator[str]:
        return iter(_MODULES)

    def __len__(self) -> int:
        return len(_MODULES)


@click.group(
    cls=Program, commands=_Commands(), context_settings={"help_option_names": ["-h", "--help"]}
)
@click.version_option(__version__, prog_name="featherfx")
def main() -> None:
    """Feathers from groom files to simulated USD caches.

    Exit codes: 0 done, 1 the input is wrong or the work failed, 2 wrong usage.
    """


def run() -> None:
    """Run the command as a process of its own."""
    use_utf8()
    try:
        main(prog_name="featherfx")
    except SystemExit as end:
        leave(end.code)
        raise
