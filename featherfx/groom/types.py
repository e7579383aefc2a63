"""What a feather is and where feathers grow: the data that an artist writes down.

Units are SI (metres, kilograms, seconds, pascals) and angles are in degrees, as in the files.
The feather frame: x leaves the follicle along the rachis, y points to the leading vane, z is
dorsal (the upper side of the vane).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class RachisShape:
    """The shaft at rest.

    diameter_base, diameter_tip: m, outer diameter at the follicle and at the tip.
    taper: exponent p of d(s) = tip + (base - tip) (1 - s)^p, s = arc length / length.
    camber: deg, total turning of the tangent towards ventral (-z) from base to tip.
    sweep: deg, total turning of the tangent towards the trailing side (-y).
    twist: deg, total turning of the vane about the tangent (right-handed).
    """

    diameter_base: float
    diameter_tip: float
    taper: float
    camber: float
    sweep: float
    twist: float


@dataclass(frozen=True)
class BarbGuide:
    """A barb that the artist drew; barbs between two guides are interpolated.

    position: share of the vane's length along the rachis, 0 at the first barb, 1 at the tip.
    angle: deg, barb angle, between rachis tangent and barb at the barb's root.
    curl: deg, turning of the barb within the vane towards the rachis tip, root to end.
    camber: deg, turning of the barb towards ventral (-z), root to end.
    """

    position: float
    angle: float
    curl: float
    camber: float


@dataclass(frozen=True)
class VaneShape:
    """One vane at rest, on the flattened feather (before camber, sweep and twist of the rachis).

    outline: ((x, y), ...), the vane's edge from base to tip as control points; x is the share of
        the vane's length along the rachis, y >= 0 the distance from the rachis as a share of the
        feather's length. Empty: no vane on this side.
    guides: barb guides in ascending position, at least one where there is an outline.
    """

    outline: tuple[tuple[float, float], ...]
    guides: tuple[BarbGuide, ...]


@dataclass(frozen=True)
class VaneMaterial:
    """The vane as a barb-and-barbule membrane (references: Jouve 2024, tables 5.1, 5.2, 6.1).

    along, across, shear: Pa, moduli along the barbs, across them and in shear (stress = shear
        modulus times engineering shear).
    thickness: m.
    surface_density: kg/m^2.
    barb_bending_normal, barb_bending_in_plane: N m, bending stiffness of the barbs per metre of
        vane across the barbs, out of the vane and within it, at the barb's root.
    barb_taper: exponent p: both barb stiffnesses fall as (1 - s)^p towards the barb's end, floored
        at 5 % of the root's.
    bending_across: N m, bending modulus of the vane across the barbs (barbs stay straight).
    loss_factor: damping of the vane, tangent of the loss angle at the feather's first frequency.
    compression_guard: Pa, modulus of a penalty on lost area; 0: none.
    barb_clamp_normal, barb_clamp_in_plane: rad / N, turn of the barbs' roots out of the vane and
        within it under a moment of 1 N m per metre of vane; 0: rigid.
    """

    along: float
    across: float
    shear: float
    thickness: float
    surface_density: float
    barb_bending_normal: float
    barb_bending_in_plane: float
    barb_taper: float
    bending_across: float
    loss_factor: float
    compression_guard: float = 0.0
    barb_clamp_normal: float = 0.0
    barb_clamp_in_plane: float = 0.0


@dataclass(frozen=True)
class RachisMaterial:
    """The shaft's keratin cortex around a light core.

    young, shear: Pa, of the cortex.
    wall: share of the radius that is cortex (1: solid).
    flattening: height across the vane over width within the vane of the elliptic section.
    cortex_density, core_density: kg/m^3.
    loss_factor: damping, as in VaneMaterial.
    """

    young: float
    shear: float
    wall: float
    flattening: float
    cortex_density: float
    core_density: float
    loss_factor: float


@dataclass(frozen=True)
class FeatherKind:
    """A feather at rest, with its materials; every preset and override is already merged.

    name: name of the kind.
    length: m, arc length of the rachis with the calamus.
    calamus: share of the length that is bare.
    barb_spacing: m, distance of real barbs along the rachis.
    """

    name: str
    length: float
    calamus: float
    barb_spacing: float
    rachis: RachisShape
    leading: VaneShape
    trailing: VaneShape
    vane_material: VaneMaterial
    rachis_material: RachisMaterial


@dataclass(frozen=True)
class Joint:
    """A node of the skeleton that carries roots.

    position: (3,) m, pivot at rest in the groom's frame.
    parent: name of the parent joint, empty for none.
    role: what a motion preset drives it as: "body", "shoulder", "elbow" or "wrist".
    side: +1 on the bird's left, -1 on its right, 0 in the middle (mirrors the flap).
    """

    name: str
    position: Array
    parent: str
    role: str
    side: int


@dataclass(frozen=True)
class Placement:
    """One feather of a groom.

    id: unique name. kind: merged kind. region: free label, written to USD.
    position: (3,) m, and rotation: (3, 3), columns the feather's x, y, z axes, in the groom's
        frame at rest. joint: name of the joint that carries the root ("" : the groom itself).
    mirrored: whether the feather belongs to the left wing: its leading vane lies at -y of its
        frame, and the rest shape is mirrored at y = 0 (sweep, twist); camber stays ventral.
    skin: path of the mesh that the root sits on ("": the shot's). skin_uv: place on it in texture
        space, instead of the closest one.
    prototype, size: the kind is the prototype `size` times as large; feathers that share a
        prototype differ in size only (None: kind itself).
    layer: feathers of a higher layer lie over those of a lower one.
    rank: place in the order in which the layout laid all feathers, a higher one over a lower; -1
        where there was none.
    stack: within a region's layer, a higher stack lies over a lower one; 0: where roots lie tells.
    grown: whether a region made it; a layout may shorten or drop such a feather.
    """

    id: str
    kind: FeatherKind
    region: str
    position: Array
    rotation: Array
    joint: str = ""
    mirrored: bool = False
    skin: str = ""
    skin_uv: tuple[float, float] | None = None
    prototype: FeatherKind | None = None
    size: float = 1.0
    layer: int = 0
    stack: int = 0
    rank: int = -1
    grown: bool = False


@dataclass(frozen=True)
class Layout:
    """How feathers are laid over each other at rest.

    clearance: m, gap that is aimed at. most_tilt: deg, and most_lift: m, by which a feather is
    raised at most. most_tilt_placed: deg, the same of feathers that no region made. least_size:
    share of its length down to which a grown feather that does not come clear is shortened.
    drop: m, depth beyond which it is left out, None: never.
    """

    clearance: float
    most_tilt: float
    most_lift: float
    most_tilt_placed: float = 20.0
    least_size: float = 1.0
    drop: float | None = None


@dataclass(frozen=True)
class Groom:
    """Which feathers, where. Frame: z up, metres.

    layout: None where feathers stay as they were placed. skin: corners (T, 3, 3) m of the meshes
    that regions grow on, None where there are none.
    """

    name: str
    source: Path
    feathers: tuple[Placement, ...]
    joints: tuple[Joint, ...] = field(default=())
    layout: Layout | None = None
    skin: Array | None = None
