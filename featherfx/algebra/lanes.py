"""Four numbers side by side that kernels calculate with as with one: a vector of the processor.

LLVM makes vectors of loops over arrays by itself, but not of sums that are kept in registers over a
loop, nor of what is shared by several of its turns. There kernels say so: `load` takes four
neighbouring numbers of a line, + - * /, sqrt, ceil, max and min work on each, a plain number stands
for four equal ones, and `put` writes them. What takes tuples of numbers (vec3_kernels, and slopes
of energies) takes tuples of lanes as well. A line is (.,), or an array in order, place by place.
"""

from __future__ import annotations

from featherfx.jit.kernel_calls import Intrinsic

COUNT = 4
# where it is said what each of these does
_TYPES = "featherfx.algebra.intrinsics"
load = Intrinsic(_TYPES, "load")
put = Intrinsic(_TYPES, "put")
spread = Intrinsic(_TYPES, "spread")
lane = Intrinsic(_TYPES, "lane")
increase = Intrinsic(_TYPES, "increase")
follow = Intrinsic(_TYPES, "follow")
transposed = Intrinsic(_TYPES, "transposed")
totals = Intrinsic(_TYPES, "totals")
where_there = Intrinsic(_TYPES, "where_there")
chosen = Intrinsic(_TYPES, "chosen")
