"""Types and names of the USD writer and readers, and the USD library of this process.

The library is a host's own, or the wheel `usd-core`. All is importable without it.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from featherfx.algebra.types import Array
from featherfx.errors import InputError, Problem, require
from featherfx.feather.types import BarbCurves, Feather, RowMap, RowPoints
from featherfx.files.process import refuse_small_address_space
from featherfx.groom.types import FeatherKind
from featherfx.usd.write.options import StageOptions

if TYPE_CHECKING:
    from featherfx.feather.colours import FeatherColours
    from featherfx.shot.skin import SkinRoot


# What may be written of a pose besides, by the names that users ask for.
ACCELERATIONS = "accelerations"
BARB_DIRECTION = "primvars:barbDirection"
STRAIN_ACROSS, STRAIN_SHEAR = "primvars:strainAcross", "primvars:strainShear"
ENERGY_DENSITY = "primvars:energyDensity"
# of vanes whose hooks may slip, per face
HOOKED_PRIMVAR, SLIP_PRIMVAR = "primvars:hooked", "primvars:slip"
HOOK_PRIMVARS = (HOOKED_PRIMVAR, SLIP_PRIMVAR)
# of wet feathers, per face, or per rachis of condensed ones: how far the ends of drawn barbs come
# together, 0 to 1, and in how many clumps a vane
WET_PRIMVARS = ("primvars:wetClump", "primvars:wetClumps")
DIAGNOSTICS = {"strain": (STRAIN_ACROSS, STRAIN_SHEAR), "energy": (ENERGY_DENSITY,)}

# of condensed feathers, on the points of rachises: their barbs' nodes, left and right (P_BARB), and
# the rotation that turns x, y and z to along the rachis, its d2 and dorsal
BARB_NODE_PRIMVARS = ("primvars:P_barbl", "primvars:P_barbr")
ORIENT_PRIMVAR = "primvars:barborient"
# what half of the rows and nodes leave out of all (featherfx/feather/detail.py), and the grid of a
# feather, rows and columns
DETAIL_ATTRIBUTE, DETAIL_GRID_ATTRIBUTE = "featherDetail", "featherDetail:grid"
# the shape that they are built of, as text (featherfx/feather/build.py), and its factor
SHAPE_PRIMVAR, SHAPE_SIZE_PRIMVAR = "featherShape", "shapeSize"
# their colours, as text (groom/materials.py), and linear at their barbs' nodes, as P_BARB
COLOUR_PRIMVAR, BARB_COLOUR_PRIMVARS = "featherColour", ("displayColor_barbl", "displayColor_barbr")
# of meshes, how their barbs look in pictures, as text (groom/materials.py)
LOOK_PRIMVAR = "barbLook"
# and how many real barbs each vane has
BARB_COUNT_PRIMVAR = "barbCount"

# The prims of a feather, or of several that share them, and what is written of these: what is a
# rate, and what has a value for each face or rachis. All else has one for each point.
MESH_PRIM, RACHIS_PRIM, BARB_PRIM = "mesh", "rachis", "barbs"
RATES = ("velocities", ACCELERATIONS)
PER_FACE_PRIMVARS = (
    BARB_DIRECTION,
    *HOOK_PRIMVARS,
    *WET_PRIMVARS,
    *(name for names in DIAGNOSTICS.values() for name in names),
)
# tables of prims that feathers share: first and number of each feather's points, faces, curves
RANGES_PREFIX = "featherRange"


class OutputError(InputError):
    """An output cannot be written: where, and why. Nothing was left under the final name."""


# what a second bake of a cache is told
BUSY_MESSAGE = "another bake is writing this cache; wait for it or choose another name"


class BusyError(OutputError):
    """Another process is writing this output."""


@dataclass(frozen=True)
class FeatherEntry:
    """One feather of a cache.

    id: unique name, kept as the primvar featherId and made a prim name. kind, region: labels.
    feather: rest geometry. rest_points: at rest in the world frame.
    root: where the feather sits on a skin, written as primvars.
    static: promise that the feather never leaves rest_points; its frames are not looked at.
    name: of the prim; empty: made from the id.
    points_map: from the points of frames, where these are of another grid, to those of
        feather.
    barbs: drawn as curves besides; their points are at rest in the world frame.
    vane_stiffness: N/m, thickness times modulus across the barbs and in shear, for the energy.
    stiffened: per triangle, factors of both; None: 1.
    held: per triangle, share of barbules that are hooked at rest; None: all.
    barb_widths: (m,) m, diameters of a barb at its nodes, root to end, the root left out.
    hooked: whether the state of its hooks is written: the share that holds to 0 (open), and their
        slip. Else `held` is, where it is given.
    wet: whether barbs come together in clumps at times, which is written.
    colours: linear; None where no feather of the cache has any.
    shape: kind that the feather is built of, whether mirrored, and how many times as large it is;
        condensed feathers are expanded by it.
    chart: (4,) u, v, du, dv of its texture coordinates in the pictures (usd/write/materials.py).
    look: of its barbs in pictures, as text (groom/materials.py); empty: smooth.
    barb_count: real barbs along each vane; 0: not known.
    """

    id: str
    kind: str
    region: str
    feather: Feather
    rest_points: RowPoints
    static: bool = False
    root: SkinRoot | None = None
    name: str = ""
    points_map: RowMap | None = None
    barbs: BarbCurves | None = None
    vane_stiffness: tuple[float, float] = (0.0, 0.0)
    stiffened: Array | None = None
    held: Array | None = None
    hooked: bool = False
    wet: bool = False
    barb_widths: Array | None = None
    colours: FeatherColours | None = None
    shape: tuple[FeatherKind, bool, float] | None = None
    chart: Array | None = None
    look: str = ""
    barb_count: int = 0


# m from the world's origin, beyond which points of single precision would be coarse
_MAX_DISTANCE = 100.0


@dataclass(frozen=True)
class StageSpace:
    """Units, up axis and origin of a stage.

    meters_per_unit: m, length of one stage unit. up_axis: "Y" or "Z". origin: m, world, position of
    the root prim; points are written relative to it.
    """

    meters_per_unit: float = 1.0
    up_axis: str = "Z"
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)

    @staticmethod
    def from_options(options: StageOptions) -> StageSpace:
        """Return the space of options; default: metres and "Z"."""
        unit, axis = options.meters_per_unit, options.up_axis
        return StageSpace(1.0 if unit is None else unit, "Z" if axis is None else axis)

    @property
    def is_moved(self) -> bool:
        """Return whether the root prim stands away from the world's origin."""
        return self.origin != (0.0, 0.0, 0.0)

    @property
    def to_world(self) -> Array:
        """Return (3, 3) from the stage to the world, metres and z up, for row vectors."""
        turn = np.eye(3)
        if self.up_axis == "Y":
            turn = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
        return self.meters_per_unit * turn

    def directions(self, vectors: Array) -> Array:
        """Return (..., 3) directions, rotated but not scaled."""
        if self.up_axis == "Z":
            return vectors
        # A quarter turn about x: a proper rotation, so that windings keep their sense.
        return np.stack([vectors[..., 0], vectors[..., 2], -vectors[..., 1]], axis=-1)

    def positions(self, points: Array) -> Array:
        """Return (..., 3) m (or m/s), rotated and scaled to stage units."""
        return self.directions(points) / self.meters_per_unit

    def lengths(self, values: Array) -> Array:
        """Return lengths in m, in stage units."""
        return values / self.meters_per_unit


def choose_origin(positions: ArrayLike) -> tuple[float, float, float]:
    """Return the origin of the root prim for feathers at (N, 3) positions, m.

    It is the world's origin unless the feathers are far from it, else their middle in whole metres.
    """
    middle: Array = np.round(np.reshape(positions, (-1, 3)).mean(axis=0))
    if np.linalg.norm(middle) <= _MAX_DISTANCE:
        return 0.0, 0.0, 0.0
    return float(middle[0]), float(middle[1]), float(middle[2])


MIN_USD_VERSION = (0, 24, 3)
# the library that every program with USD loads first; all in one, or with the others beside it
_LIBRARY = re.compile(r"lib(?:\w*_)?(?:usd|pxr)_(?:ms|tf)\b[^/]*\.so[^/]*")
_MAPS = Path("/proc/self/maps")


@cache
def refuse_unfit_usd() -> None:
    """Raise InputError for a USD that is too old, or that is loaded twice in this process.

    Two libraries of USD share neither layers nor types, and crash the process sooner or later. Only
    Linux lists the loaded libraries.
    """
    refuse_small_address_space()
    from pxr import Usd

    problems = []
    if (found := Usd.GetVersion()) < MIN_USD_VERSION:
        told = "is USD {}.{}, but 24.3 is the oldest that is read and written".format(*found[1:])
        problems.append(Problem(str(Path(Usd.__file__).parent.parent), "", told))
    if len(loaded := loaded_libraries()) > 1:
        told = f"is loaded beside {', '.join(loaded[1:])}: two installs of USD in one process"
        problems.append(Problem(loaded[0], "", f"{told}. Use the host's alone (docs/dcc.md)"))
    require(*problems)


def loaded_libraries() -> list[str]:
    """Return the files of USD's base library in this process; none where the system lists none."""
    try:
        lines = _MAPS.read_text(errors="replace").splitlines()
    except OSError:
        return []
    files = {line.split(maxsplit=5)[-1] for line in lines if line.count("/")}
    return sorted(file for file in files if _LIBRARY.fullmatch(file.rpartition("/")[2]))


def usd_version() -> tuple[str, Path]:
    """Return the version of USD, such as "26.11", and its folder.

    Raises ModuleNotFoundError where there is none.
    """
    from pxr import Usd

    return "{}.{:02}".format(*Usd.GetVersion()[1:]), Path(Usd.__file__).parents[2]
