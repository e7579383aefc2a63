"""Loops over whole arrays, without the temporaries that expressions of arrays would allocate."""

from featherfx.jit.compiled import kernel, loop_kernel


@kernel
def copy_values(source, target):
    """target[...] = source for arrays of one shape and contiguous memory."""
    from_flat, to_flat = source.flat, target.flat
    for i in range(source.size):
        to_flat[i] = from_flat[i]


@loop_kernel
def add_scaled(factor, line, to):
    """to += factor line for lines (N,) that do not overlap."""
    for k in range(to.shape[0]):
        to[k] += factor * line[k]


@kernel
def product(a, b):
    """The sum of a_k b_k of lines (N,)."""
    total = 0.0
    for k in range(a.shape[0]):
        total += a[k] * b[k]
    return total
