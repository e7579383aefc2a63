"""`featherfx completion`: what makes a shell complete commands and options."""

from __future__ import annotations

import click
from click.shell_completion import get_completion_class

from featherfx.cli.program import Command


@click.command(
    cls=Command,
    short_help="Print what makes a shell complete commands and options.",
    epilog="""
    featherfx completion bash >> ~/.bashrc
    featherfx completion zsh >> ~/.zshrc
    featherfx completion fish > ~/.config/fish/completions/featherfx.fish
    """,
)
@click.argument("shell", type=click.Choice(("bash", "zsh", "fish")))
@click.pass_context
def completion(ctx: click.Context, shell: str) -> None:
    """Print a script for SHELL, to be read when it starts.

    With it, the tab key completes commands, options and names of files, samples and kinds.
    """
    kind = get_completion_class(shell)
    assert kind is not None
    program = ctx.find_root().command
    click.echo(kind(program, {}, "featherfx", "_FEATHERFX_COMPLETE").source())
