"""Angles of four vectors at a time (lanes), and cosines in loops; for single ones LLVM calls the
system's library, which makes no vectors.

Source of the angles: the rational function of Cephes (S. L. Moshier), atan.c: below 0.66

    atan r = r + r z P(z) / Q(z),      z = r^2

to 2e-16 of itself; beyond it atan t = pi / 4 + atan((t - 1) / (t + 1)). Cosines are Taylor's series
around the nearest multiple of pi, to 3e-16 and what the angle itself is rounded by.
"""

from math import factorial, pi

import numpy as np

from featherfx.algebra.lanes import chosen, spread
from featherfx.jit.compiled import kernel

_CUT = 0.66
# of r^0, r^2, ... r^22
_COSINE = tuple((-1) ** k / factorial(2 * k) for k in range(12))


@kernel
def arctan2(y, x):
    """atan2 of lanes."""
    zero, up, along = spread(0.0), max(y, -y), max(x, -x)
    large, small = max(up, along), min(up, along)
    cut = _CUT * large
    r = chosen(small, cut, small - large, small) / chosen(small, cut, small + large, large)
    z = r * r
    p = -16.15753718733365076637 + z * -0.8750608600031904122785
    p = -122.8866684490136173410 + z * (-75.00855792314704667340 + z * p)
    p = -64.85021904942025371773 + z * p
    q = 165.0270098316988542046 + z * (24.85846490142306297962 + z)
    q = 485.3903996359136964868 + z * (432.8810604912902668951 + z * q)
    q = 194.5506571482613964425 + z * q
    angle = r + r * (z * p / q)
    angle = chosen(small, cut, 0.25 * pi + angle, angle)
    angle = chosen(up, along, 0.5 * pi - angle, angle)
    angle = chosen(zero, x, pi - angle, angle)
    return chosen(zero, y, -angle, angle)


@kernel
def cosine(angle):
    """cos of one angle of many in a loop, rad."""
    turns = np.floor(angle / pi + 0.5)
    r = angle - pi * turns
    z, c = r * r, _COSINE
    total = c[8] + z * (c[9] + z * (c[10] + z * c[11]))
    total = c[4] + z * (c[5] + z * (c[6] + z * (c[7] + z * total)))
    total = c[0] + z * (c[1] + z * (c[2] + z * (c[3] + z * total)))
    odd = turns - 2.0 * np.floor(0.5 * turns)
    return total - 2.0 * odd * total
