"""First module of workers of this machine, which leave Ctrl-C to the command that started them.

While they load the program Python seldom looks for cycles to free, a tenth of that time, and they
end without taking apart what they hold.
"""

from __future__ import annotations

import os
import signal
import sys
from contextlib import ExitStack

from featherfx.files.process import seldom_collected

signal.signal(signal.SIGINT, signal.SIG_IGN)
_loading = ExitStack()
_loading.enter_context(seldom_collected())


def dask_setup(worker: object) -> None:
    """Called by Dask in a worker that starts, when all is loaded."""
    _loading.close()


def dask_teardown(worker: object) -> None:
    """Called by Dask in a worker that ends. One that is at work leaves that as it should be."""
    from featherfx.farm.cluster import is_at_work

    if not is_at_work():
        for stream in (sys.stdout, sys.stderr):
            stream.flush()
        os._exit(0)
