"""Which prims a cache has, by the form that is asked for; needs no USD.

    form        feathers (meshes)   rachises (curves)      barbs (curves, where N are asked for)
    mesh        yes                 yes                    yes
    curves                          yes                    yes
    condensed                       with barbs as arrays
    both        yes                 with barbs as arrays   yes

A condensed feather is its shaft: every point of it carries the nodes of its two barbs, from root to
end and without the root, as the primvars P_barbl and P_barbr; left is as seen from dorsal with the
tip ahead.
"""

from __future__ import annotations

from dataclasses import dataclass

from featherfx.usd.types import BARB, MESH, RACHIS, RATES
from featherfx.usd.write.options import BOTH, CONDENSED, CURVES, WriteOptions

_PARTS = {CURVES: (RACHIS, BARB), CONDENSED: (RACHIS,)}


@dataclass(frozen=True)
class Form:
    """parts: the prims of each feather. condensed: whether shafts carry barbs. rates: whether
    velocities and accelerations are written; half: velocities in half precision."""

    parts: tuple[str, ...] = (MESH, RACHIS, BARB)
    condensed: bool = False
    rates: bool = True
    half: bool = False

    @staticmethod
    def of(options: WriteOptions) -> Form:
        parts = _PARTS.get(options.form, Form.parts)
        rates = options.velocities != "none"
        return Form(parts, options.form in (CONDENSED, BOTH), rates, options.velocities == "half")

    def writes(self, key: tuple[str, str]) -> bool:
        """Whether an attribute of a part of feathers is written."""
        return key[0] in self.parts and (self.rates or key[1] not in RATES)
