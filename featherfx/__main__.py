"""`python -m featherfx`: the same as the command `featherfx`."""

from featherfx.cli.main import run

run()
