"""Where a root is within a frame: a polynomial through samples of its path.

A path is (K, 6): position (m) and rotation vector relative to the frame's first sample (rad) at K
evenly spaced fractions of the frame; the rotation vectors are unwrapped, so that a root may spin
several turns in a frame. The polynomial through all samples is smooth, so sub-steps of any length
see no kinks.
"""

from featherfx.algebra.rotation_kernels import exponential, multiply, normalised, store_rotation
from featherfx.algebra.vec3_kernels import store
from featherfx.jit.compiled import kernel


@kernel
def root_at(path, f, fraction, turn, centre):
    """Root quaternion (4,) and position (3,) of feather f at a fraction 0..1 of the frame, written
    in place; path: RootPath.
    """
    samples, base = path.samples[f], path.base[f]
    count = samples.shape[0]
    value = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    x, y, z, rx, ry, rz = value
    for i in range(count):
        weight = 1.0
        for j in range(count):
            if j != i:
                weight *= (fraction * (count - 1) - j) / (i - j)
        x += weight * samples[i, 0]
        y += weight * samples[i, 1]
        z += weight * samples[i, 2]
        rx += weight * samples[i, 3]
        ry += weight * samples[i, 4]
        rz += weight * samples[i, 5]
    store(centre, (x, y, z))
    store_rotation(turn, normalised(multiply(exponential((rx, ry, rz)), base)))
