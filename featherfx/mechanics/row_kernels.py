"""Nodes and directors of a feather's rows (featherfx/feather/types.py) in kernels."""

from featherfx.algebra.array_kernels import copy_values
from featherfx.feather.types import RowPoints
from featherfx.jit.compiled import kernel


@kernel
def node_index(side, column, columns):
    """Place of a barb node within its row; column 0 is the rachis."""
    return 0 if column == 0 else side * columns + column


@kernel
def points_of(points, f):
    """RowPoints of one of many feathers, the same memory."""
    return RowPoints(points.nodes[f], points.directors[f])


@kernel
def copy_points(source, target):
    """All of one RowPoints to another's."""
    copy_values(source.nodes, target.nodes)
    copy_values(source.directors, target.directors)
