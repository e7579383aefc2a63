"""Segments of barbs that keep their length: excess strain and its gradient.

The strain is that of barb_stretch_kernels.py.
"""

from featherfx.jit.compiled import kernel
from featherfx.lab.nodal.barb_stretch_kernels import stretch_gradient, stretch_strain


@kernel
def chain_system(positions, chains, inverse, line, ends, excess, table):
    """e to excess (S,) and its gradient by both ends to table (S, 4): x, y of one, of the other.

    positions: (N, 2) m. chains: (S, 2). inverse: (S,) 1/m. line: (6,) and ends: (2, 3), scratch.
    """
    for s in range(chains.shape[0]):
        for end in range(2):
            ends[end, 2] = 0.0
            for axis in range(2):
                ends[end, axis] = positions[chains[s, end], axis]
        excess[s] = stretch_strain(ends[0], ends[1], inverse[s])
        stretch_gradient(ends[0], ends[1], inverse[s], line)
        for axis in range(2):
            table[s, axis], table[s, 2 + axis] = line[axis], line[3 + axis]
