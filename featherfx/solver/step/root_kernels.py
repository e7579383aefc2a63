"""Place of a root within a frame: a polynomial through samples of its path.

A path is (K, 6): position (m) and rotation vector relative to the frame's first sample (rad) at K
evenly spaced fractions of the frame; the rotation vectors are unwrapped, so that a root may spin
several turns in a frame. The polynomial through all samples is smooth, so sub-steps of any length
see no kinks.
"""

from featherfx.algebra.rotation_kernels import exponential, multiply, normalised, store_rotation
from featherfx.algebra.vec3_kernels import add, scale, store
from featherfx.jit.compiled import kernel


@kernel
def root_at(path, f, fraction, rotation, centre):
    """Root quaternion (4,) and position (3,) of feather f at a fraction 0..1 of the frame, written
    in place; path: RootPath.
    """
    samples = path.samples[f]
    count = samples.shape[0]
    place, vector = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    for i in range(count):
        weight = 1.0
        for j in range(count):
            if j != i:
                weight *= (fraction * (count - 1) - j) / (i - j)
        place = add(place, scale(weight, samples[i]))
        vector = add(vector, scale(weight, samples[i, 3:]))
    store(centre, place)
    store_rotation(rotation, normalised(multiply(exponential(vector), path.base[f])))
