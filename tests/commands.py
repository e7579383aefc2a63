"""The program's commands, run in this process."""

from typing import Any

from click.testing import CliRunner, Result

from featherfx.cli.main import main


def invoke(*arguments: object, **options: Any) -> Result:
    """A command. options: of the runner."""
    return CliRunner().invoke(main, [str(each) for each in arguments], **options)
