"""Where a root is within a frame: a polynomial through samples of its path.

A path is (K, 6): position (m) and rotation vector relative to the frame's first sample (rad) at K
evenly spaced shares of the frame; the rotation vectors are unwrapped, so that a root may spin
several turns in a frame. The polynomial through all samples is smooth, so sub-steps of any length
see no kinks.
"""

from featherfx.algebra.rotation_kernels import exponential, multiply, normalised, store_rotation
from featherfx.algebra.vec3_kernels import store
from featherfx.jit.compiled import kernel


@kernel
def root_at(path, base, share, turn, centre):
    """Root quaternion (4,) and position (3,) at a share 0..1 of the frame, written in place.

    path: (K, 6). base: (4,) quaternion of the first sample.
    """
    count = path.shape[0]
    value = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    x, y, z, rx, ry, rz = value
    for i in range(count):
        weight = 1.0
        for j in range(count):
            if j != i:
                weight *= (share * (count - 1) - j) / (i - j)
        x += weight * path[i, 0]
        y += weight * path[i, 1]
        z += weight * path[i, 2]
        rx += weight * path[i, 3]
        ry += weight * path[i, 4]
        rz += weight * path[i, 5]
    store(centre, (x, y, z))
    store_rotation(turn, normalised(multiply(exponential((rx, ry, rz)), base)))
