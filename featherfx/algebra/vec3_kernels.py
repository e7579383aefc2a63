"""Vectors in kernels: 3-tuples, or arrays (3,) where they are read; results are 3-tuples."""

from math import sqrt

from featherfx.jit.compiled import kernel


@kernel
def add(a, b):
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


@kernel
def sub(a, b):
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@kernel
def scale(s, a):
    return s * a[0], s * a[1], s * a[2]


@kernel
def over(a, s):
    """a / s."""
    return a[0] / s, a[1] / s, a[2] / s


@kernel
def combined(s, a, t, b):
    """s a + t b."""
    return s * a[0] + t * b[0], s * a[1] + t * b[1], s * a[2] + t * b[2]


@kernel
def dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@kernel
def cross(a, b):
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@kernel
def length(a):
    return sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2])


@kernel
def normal_of(start, first, second):
    """(first - start) x (second - start): twice the area of a triangle along its normal."""
    return cross(sub(first, start), sub(second, start))


@kernel
def store(array, a):
    """array (3,) = a."""
    array[0], array[1], array[2] = a[0], a[1], a[2]


@kernel
def accumulate(array, s, a):
    """array (3,) += s a."""
    array[0] += s * a[0]
    array[1] += s * a[1]
    array[2] += s * a[2]
