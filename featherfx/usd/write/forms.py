"""Prims of a cache, by its form, and the feathers that share them; needs no USD.

    form        feathers (meshes)   rachises (curves)      barbs (curves, where N are asked for)
    mesh        yes                 yes                    yes
    curves                          yes                    yes
    condensed                       with barbs as arrays
    both        yes                 with barbs as arrays   yes

condensed.py describes condensed feathers.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import NamedTuple

from featherfx.usd.types import (
    ACCELERATIONS,
    BARB_DIRECTION,
    BARB_NODE_PRIMVARS,
    BARB_PRIM,
    DETAIL_ATTRIBUTE,
    DIAGNOSTICS,
    HOOK_PRIMVARS,
    MESH_PRIM,
    ORIENT_PRIMVAR,
    RACHIS_PRIM,
    RATES,
    WET_PRIMVARS,
    FeatherEntry,
)
from featherfx.usd.write.options import (
    AS_ONE,
    BOTH_FORMS,
    BY_FEATHER,
    BY_REGION,
    CONDENSED_FORM,
    CURVES_FORM,
    WriteOptions,
)
from featherfx.usd.write.output import unique_prim_names

# Feathers that each have prims of their own where that is left to the writer; readers are slow with
# thousands of prims side by side.
_MAX_SINGLE = 200

# part of a feather, and attribute
AttributeKey = tuple[str, str]

_PARTS = {CURVES_FORM: (RACHIS_PRIM, BARB_PRIM), CONDENSED_FORM: (RACHIS_PRIM,)}


@dataclass(frozen=True)
class CacheForm:
    """Form of the feathers in a cache.

    parts: the prims of each feather. condensed: whether rachises carry barbs, and thinned: half of
    their rows and nodes. rates: whether velocities and accelerations are written; half: velocities
    in half precision.
    """

    parts: tuple[str, ...] = (MESH_PRIM, RACHIS_PRIM, BARB_PRIM)
    condensed: bool = False
    rates: bool = True
    half: bool = False
    thinned: bool = False

    @staticmethod
    def of(options: WriteOptions) -> CacheForm:
        parts = _PARTS.get(options.form, CacheForm.parts)
        return CacheForm(
            parts,
            condensed=options.form in (CONDENSED_FORM, BOTH_FORMS),
            rates=options.rates != "none",
            half=options.rates == "half",
            thinned=options.form == CONDENSED_FORM,
        )

    def writes(self, key: AttributeKey) -> bool:
        """Return whether an attribute of a part of feathers is written."""
        return key[0] in self.parts and (self.rates or key[1] not in RATES)


class AttributeKeys(NamedTuple):
    """Attributes of a feather, by their values: vectors, numbers, rotations, integers.

    wet: numbers of feathers that are wet at times.
    """

    vectors: tuple[AttributeKey, ...]
    scalars: tuple[AttributeKey, ...]
    turns: tuple[AttributeKey, ...]
    whole: tuple[AttributeKey, ...]
    wet: tuple[AttributeKey, ...]


@cache
def find_keys(
    parts: tuple[str, ...],
    extras: frozenset[str],
    form: CacheForm,
    faces: bool,
    hooks: bool,
    wet: bool,
) -> AttributeKeys:
    """Return the attributes of feathers with these parts; equal feathers share them.

    extras: ACCELERATIONS, names of DIAGNOSTICS. faces: whether there are any. hooks, wet: whether
    their state is written.
    """
    each = ("points", "velocities", *([ACCELERATIONS] * (ACCELERATIONS in extras)))
    asked = [name for extra, names in DIAGNOSTICS.items() if extra in extras for name in names]
    asked += HOOK_PRIMVARS if hooks else ()
    shown = (MESH_PRIM, faces), (RACHIS_PRIM, form.condensed)
    clumps = tuple(
        (part, name) for part, is_shown in shown for name in WET_PRIMVARS if wet and is_shown
    )
    return AttributeKeys(
        vectors=(
            *((part, name) for part in parts for name in each),
            (MESH_PRIM, "normals"),
            (MESH_PRIM, BARB_DIRECTION),
            *((RACHIS_PRIM, name) for name in BARB_NODE_PRIMVARS if form.condensed),
        ),
        scalars=(*((MESH_PRIM, name) for name in asked), *clumps),
        turns=((RACHIS_PRIM, ORIENT_PRIMVAR),) if form.condensed else (),
        whole=((RACHIS_PRIM, DETAIL_ATTRIBUTE),) if form.thinned else (),
        wet=clumps,
    )


class MeshGroup(NamedTuple):
    """Feathers of one mesh. name: of its prim. members: their numbers, in order."""

    name: str
    members: tuple[int, ...]


def choose_group(group: str | None, feathers: int) -> str:
    """Return the grouping of a cache: as given, else by region if feathers are many."""
    return group or (BY_REGION if feathers > _MAX_SINGLE else BY_FEATHER)


def group_feathers(
    entries: Sequence[FeatherEntry], group: str, part: str = "", condensed: bool = False
) -> list[MeshGroup]:
    """Return the groups of a cache, in the order of their first feathers.

    group: of GROUPINGS; feathers without a region go by their kind. part: suffix of the names,
    where the cache is a part of a larger one with the same groups. condensed: feathers of one group
    must have as many barb nodes, since a primvar has one element size; others are grouped by these.
    """
    if group == BY_FEATHER:
        names = unique_prim_names([entry.name or entry.id for entry in entries])
        return [MeshGroup(name, (number,)) for number, name in enumerate(names)]
    members: dict[str, list[int]] = {}
    first: dict[str, int] = {}
    for number, entry in enumerate(entries):
        label = (entry.region if group == BY_REGION else "") or entry.kind
        label = AS_ONE if group == AS_ONE else label
        columns = entry.feather.columns
        if condensed and columns != first.setdefault(label, columns):
            label = f"{label}_{columns}"
        members.setdefault(label, []).append(number)
    names = unique_prim_names([f"{label}_{part}" if part else label for label in members])
    return [MeshGroup(*each) for each in zip(names, map(tuple, members.values()), strict=True)]
