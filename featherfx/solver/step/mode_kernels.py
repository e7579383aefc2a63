"""The lowest mode of stiffness and mass bands, by inverse iteration."""

from featherfx.algebra.array_kernels import copy_values, product
from featherfx.jit.compiled import kernel
from featherfx.solver.step.banded_kernels import factorise, solve_factored

# iterations at most; change of the quotient, part of it, that ends them
_MAX_ITERATIONS, _QUOTIENT_TOLERANCE = 100, 1e-9


@kernel
def _times(band, x, image):
    """Symmetric band (N, B + 1), as of banded_kernels, times x (N,), to image (N,)."""
    size, width = band.shape
    image[:] = 0.0
    for j in range(size):
        for d in range(min(width, size - j)):
            image[j + d] += band[j, d] * x[j]
            if d > 0:
                image[j] += band[j, d] * x[j + d]


@kernel
def lowest_quotient(stiffness, mass, factor, panel, mode, image):
    """Smallest stiffness over mass, 1/s^2; 0 where the stiffness is not positive definite.

    stiffness, mass: bands (N, B + 1). factor, panel: scratch of factorise. mode: (N,), first guess,
    becomes the mode. image: (N,) scratch.
    """
    copy_values(stiffness, factor)
    if not factorise(factor, panel):
        return 0.0
    quotient = 0.0
    for _ in range(_MAX_ITERATIONS):
        _times(mass, mode, image)
        copy_values(image, mode)
        solve_factored(factor, mode)
        _times(mass, mode, image)
        square, before = product(mode, image), quotient
        _times(stiffness, mode, image)
        quotient = product(mode, image) / square
        for k in range(mode.shape[0]):
            mode[k] /= square**0.5
        if abs(quotient - before) <= _QUOTIENT_TOLERANCE * quotient:
            break
    return quotient
