"""Address space of a process whose limit is small (`ulimit -v`), as job schedulers set it."""

from __future__ import annotations

import math
import os

from featherfx.errors import InputError, Problem
from featherfx.files.memory import share_one_heap
from featherfx.limits import MIN_ADDRESS_SPACE, as_size, process_limit

_LIMIT = "RLIMIT_AS"


def spare_address_space() -> None:
    """Share one heap among threads where the address space has a limit, before numpy is loaded:
    each thread else reserves 64 MB, or as much again for products of matrices."""
    if process_limit(_LIMIT) < math.inf:
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
        share_one_heap()


def refuse_small_address_space() -> None:
    """Raise InputError where the limit of the address space is too small to load OpenUSD, which
    crashes instead of reporting an error."""
    limit = process_limit(_LIMIT)
    if limit < MIN_ADDRESS_SPACE:
        sizes = f"allows {as_size(limit)}, but at least {as_size(MIN_ADDRESS_SPACE)} are needed"
        text = f"{sizes}, most of them by OpenUSD. Raise it, or limit resident memory instead"
        raise InputError(Problem("limit of the address space (ulimit -v)", "", text))
