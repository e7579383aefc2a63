"""Loaded by workers of this machine: Ctrl-C is for the command that started and ends them."""

from __future__ import annotations

import signal


def dask_setup(worker: object) -> None:
    """Called by Dask in a worker that starts."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
