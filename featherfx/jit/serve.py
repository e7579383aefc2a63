"""Compile the shared kernels that compile_workers.py asks a helper process for, and store them.

Nothing is run here, so shared kernels that these call are not loaded: a place stands for their
machine code.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from typing import BinaryIO

from featherfx.jit.compile_workers import Need, received, send, work_for
from featherfx.jit.linking import kernel_of
from featherfx.jit.type_text import text_of_types


class Upstream:
    """The crew, as a helper sees it: what it needs, it tells those that it works for."""

    asked: tuple[Need, ...] = ()

    def __init__(self, stream: BinaryIO) -> None:
        self._stream = stream

    def ask(self, need: Need) -> None:
        send(self._stream, need)

    def wait_for(self, need: Need, compile_here: Callable[[Need], None]) -> None:
        """All that is compiled here is a helper's to compile."""


def main() -> None:
    """Compile what is asked for on the standard input, until it ends."""
    answers = os.fdopen(os.dup(sys.stdout.fileno()), "wb")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())
    work_for(Upstream(answers))
    while isinstance(need := received(sys.stdin.buffer), Need):
        kernel, text = kernel_of(need), text_of_types(need.args)
        if not kernel.is_there(text):
            kernel.compile_for(text, need.args)
        send(answers, True)
