"""Modules that workers of this machine have loaded when they are forked (origin.py).

Nothing of it may start threads, which a fork leaves behind. Ctrl-C is for the command.
"""

from __future__ import annotations

import importlib
import signal

from featherfx.files.gc_pause import seldom_collected

signal.signal(signal.SIGINT, signal.SIG_IGN)
with seldom_collected():
    for _name in (
        "distributed",
        "featherfx.farm.work",
        "featherfx.baking.frame_loop",
        # that a share loads when it gets so far
        "featherfx.shot.partition.dependence",
        "scipy.sparse.csgraph",
    ):
        importlib.import_module(_name)
