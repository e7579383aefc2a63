"""What threads of a team share, as LLVM does it (team.py)."""

from __future__ import annotations

from typing import Any

from llvmlite import binding
from numba.core import cgutils, types
from numba.extending import intrinsic

from featherfx.jit.thread_team import SLEEP, SLEEP_SYMBOL

binding.add_symbol(SLEEP_SYMBOL, SLEEP)
sleep = types.ExternalFunction(SLEEP_SYMBOL, types.int32(types.uint32))


@intrinsic
def fetch_add(typing_context: Any, counters: Any, place: Any, more: Any) -> Any:
    """Add to a counter at once; what it was before."""

    def code(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        array = context.make_array(counters)(context, builder, arguments[0])
        at = cgutils.get_item_pointer(
            context, builder, counters, array, [arguments[1]], wraparound=False
        )
        return builder.atomic_rmw("add", at, arguments[2], "seq_cst")

    return types.int64(counters, types.intp, types.int64), code
