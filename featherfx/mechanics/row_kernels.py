"""Where the material points of a row are, in kernels; the layout is that of feather/types.py."""

from featherfx.jit.compiled import kernel


@kernel
def is_director(p):
    """Whether a material point of a row is one of its two directors, not a position."""
    return p == 1 or p == 2


@kernel
def node_index(side, column, columns):
    """Material point of a barb node; column 0 is the rachis."""
    return 0 if column == 0 else 2 + side * columns + column
