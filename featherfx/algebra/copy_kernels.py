"""Copy arrays without the temporary that a sliced assignment would allocate."""

from featherfx.jit.compiled import kernel


@kernel
def copy_values(source, target):
    """target[...] = source for arrays of one shape and contiguous memory."""
    from_flat, to_flat = source.flat, target.flat
    for i in range(source.size):
        to_flat[i] = from_flat[i]
