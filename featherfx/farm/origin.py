"""One process that has loaded the program, from which workers of this machine are forked.

A command starts it first of all, so that another core loads the program while it loads itself, and
once for all workers. Systems without such processes start workers anew.
"""

from __future__ import annotations

import multiprocessing
import os
from contextlib import AbstractContextManager, nullcontext
from typing import Any

# of Dask's workers, as Dask sets them for those that it starts anew; large blocks that are freed
# are found again without the system
_ENVIRONMENT = {
    "MALLOC_TRIM_THRESHOLD_": str(1 << 30),
    "OMP_NUM_THREADS": "1",
    "MKL_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
}
# what it loads; nothing of it may start threads, which a fork leaves behind
_LOADED = [
    "featherfx.farm.ignore_sigint",
    "distributed",
    "featherfx.farm.work",
    "featherfx.baking.frame_loop",
    # that a share loads when it gets so far
    "featherfx.shot.contact.partition",
    "scipy.sparse.csgraph",
]
_begun: list[bool] = []


def begin() -> None:
    """Start it. Only for a command that ends with its workers, since it keeps the environment that
    it was started in."""
    if "forkserver" not in multiprocessing.get_all_start_methods():
        return
    from multiprocessing import forkserver

    before = {name: os.environ.get(name) for name in _ENVIRONMENT}
    for name, value in _ENVIRONMENT.items():
        os.environ.setdefault(name, value)
    try:
        forkserver.set_forkserver_preload(_LOADED)
        forkserver.ensure_running()
    finally:
        for name, old in before.items():
            if old is None:
                del os.environ[name]
    _begun.append(True)


def forked() -> AbstractContextManager[Any]:
    """Have Dask fork what it starts from here on, if there is something to fork it from."""
    if not _begun:
        return nullcontext()
    import dask

    way: AbstractContextManager[Any] = dask.config.set(
        {"distributed.worker.multiprocessing-method": "forkserver"}
    )
    return way
