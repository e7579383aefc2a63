"""Four numbers side by side that kernels calculate with as with one: a vector of the processor.

LLVM makes vectors of loops over arrays by itself, but not of sums that are kept in registers over a
loop, nor of what is shared by several of its turns. There kernels say so: `load` takes four
neighbouring numbers of a line, + - * /, sqrt, ceil, max and min work on each, a plain number stands
for four equal ones, and `put` writes them. What takes tuples of numbers (vec3_kernels, and slopes
of energies) takes tuples of lanes as well. A line is (.,), or an array in order, place by place.
"""

from __future__ import annotations

from featherfx.jit.lazy_import import Late

COUNT = 4
# where it is said what each of these does
_TYPES = "featherfx.algebra.lane_types"
load = Late(_TYPES, "load")
put = Late(_TYPES, "put")
spread = Late(_TYPES, "spread")
lane = Late(_TYPES, "lane")
increase = Late(_TYPES, "increase")
follow = Late(_TYPES, "follow")
transposed = Late(_TYPES, "transposed")
totals = Late(_TYPES, "totals")
where_there = Late(_TYPES, "where_there")
chosen = Late(_TYPES, "chosen")
