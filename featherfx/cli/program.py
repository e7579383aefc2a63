"""The command line as a whole: every failure becomes one message and an exit code, here only."""

from __future__ import annotations

import errno
import traceback
import warnings
from typing import Any

import click

from featherfx.errors import InputError, InputWarning, SimulationError

_VERBOSE = "featherfx.verbose"


def _remember_verbose(context: click.Context, _: click.Parameter, value: bool) -> None:
    if value:
        context.find_root().meta[_VERBOSE] = True


def _show_warning(message: Warning | str, *_: Any, **__: Any) -> None:
    click.echo(f"featherfx: warning: {message}", err=True)


def _verbose_option() -> click.Option:
    return click.Option(
        ["--verbose"],
        is_flag=True,
        expose_value=False,
        callback=_remember_verbose,
        help="Show the traceback of an error.",
    )


class _WithExamples(click.Command):
    """A command or group whose epilog holds examples."""

    def format_epilog(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        # Examples are lines of their own; click would wrap them into one paragraph.
        if self.epilog:
            with formatter.section("Examples"):
                for line in self.epilog.strip().splitlines():
                    formatter.write(f"{'':{formatter.current_indent}}{line.strip()}\n")


class Command(_WithExamples):
    """A command that takes --verbose."""

    def __init__(self, *args: Any, **options: Any) -> None:
        super().__init__(*args, **options)
        self.params.append(_verbose_option())


class CommandGroup(_WithExamples, click.Group):
    """A group of such commands."""

    command_class = Command


class Program(CommandGroup):
    """The outermost group. Exit codes: 0 done, 1 wrong input or failed work, 2 wrong usage."""

    group_class = CommandGroup

    def invoke(self, ctx: click.Context) -> Any:
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("always", InputWarning)
                warnings.showwarning = _show_warning
                return super().invoke(ctx)
        except (InputError, SimulationError) as error:
            self._fail(ctx, str(error), error)
        except KeyboardInterrupt as error:
            self._fail(ctx, str(error) or "interrupted", error)
        except OSError as error:
            if error.errno == errno.EPIPE:  # the reader of our output has gone; click knows
                raise
            place = f"{error.filename}: " if error.filename else ""
            self._fail(ctx, f"{place}{error.strerror or error}", error)

    def _fail(self, ctx: click.Context, message: str, error: BaseException) -> None:
        if ctx.meta.get(_VERBOSE):
            click.echo("".join(traceback.format_exception(error)), err=True)
        for line in message.splitlines():
            click.echo(f"featherfx: {line}", err=True)
        ctx.exit(1)
