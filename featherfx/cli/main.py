"""The `featherfx` command. A command is imported when it is called, and imports its work then."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from importlib import import_module

import click

from featherfx._version import __version__
from featherfx.cli.program import Program, leave, use_utf8

# module of featherfx.cli that holds each command, and what it does
_COMMANDS = {
    "bake": ("bake", "Simulate a shot and write it to USD."),
    "bench": ("lab.measure", "Measure run time against error."),
    "check": ("check", "Check grooms, presets, shots and USD files; measure caches."),
    "completion": ("install", "Print what makes a shell complete commands and options."),
    "doctor": ("install", "Whether this install works, and what it is made of."),
    "error": ("stats", "Error of a shot, on a few of its feathers."),
    "export": ("export", "Write a cache in another form."),
    "groom": ("export", "Write a groom's feathers at rest to USD."),
    "inspect": ("check", "What a USD file holds for grooms and shots to name."),
    "join": ("farm", "Join a cache that was baked in shares of its feathers."),
    "lab": ("lab.measure", "Virtual experiments on rods and feathers."),
    "plugins": ("install", "List plugins for other programs, and install them."),
    "presets": ("install", "List presets and show what they hold."),
    "preview": ("view", "Draw a USD file to pictures or films."),
    "retime": ("export", "Write a cache slower, faster, or as a loop."),
    "sample": ("install", "Copy a sample, a groom and a shot to start from."),
    "schema": ("install", "Print the JSON Schema of grooms, shots or presets."),
    "sculpt": ("export", "Write a cache with feathers that are corrected by hand."),
    "stats": ("stats", "Counts, overlap and expected cost."),
    "trace": ("install", "Make a feather preset of a picture."),
    "tune": ("view", "Change presets with sliders, in a browser, while feathers move."),
    "view": ("view", "Play a cache, groom or shot in a browser, or write it as one HTML file."),
}


class _Commands(Mapping[str, click.Command]):
    """Commands by name, each imported when it is asked for."""

    def __getitem__(self, name: str) -> click.Command:
        module, short_help = _COMMANDS[name]
        command: click.Command = getattr(import_module(f"featherfx.cli.{module}"), name)
        command.short_help = short_help
        return command

    def __iter__(self) -> Iterator[str]:
        return iter(_COMMANDS)

    def __len__(self) -> int:
        return len(_COMMANDS)


class _Listed(Program):
    """The program, whose help imports no command."""

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        with formatter.section("Commands"):
            formatter.write_dl([(name, told) for name, (_, told) in sorted(_COMMANDS.items())])


@click.group(
    cls=_Listed, commands=_Commands(), context_settings={"help_option_names": ["-h", "--help"]}
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
