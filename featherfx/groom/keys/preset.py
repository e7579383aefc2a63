"""Every key of every preset family."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from featherfx.groom.keys.values import (
    REQUIRED,
    Array,
    Direction,
    Either,
    Key,
    Number,
    Place,
    Table,
    Text,
    ValueType,
)


@dataclass(frozen=True)
class Preset:
    """A preset's name, or a table that extends one: a table with `base` when checked."""

    family: str

    def check(self, value: Any, place: Place, partial: bool) -> Any:
        if isinstance(value, str):
            value = {"base": value}
        return extended(self.family).check(value, place, True)

    def describe(self) -> tuple[str, str, str]:
        return f"name of a {self.family} preset, or a table that extends one", "", ""


def is_list(value: Any) -> bool:
    return isinstance(value, list)


def is_table(value: Any) -> bool:
    return isinstance(value, dict)


def is_text(value: Any) -> bool:
    return isinstance(value, str)


def vector(low: float, high: float, unit: str) -> Array:
    return Array(Number(low, high, unit), 3, 3)


BASE = Key(
    Text(),
    "Preset of the same family that this one starts from. In a user's folder, a preset that "
    "names itself extends the shipped one.",
    None,
)

GUIDE = {
    "position": Key(Number(0, 1), "Root of the barb as a share of the vane's length."),
    "angle": Key(Number(5, 120, "deg"), "Barb angle between rachis and barb, at the root."),
    "curl": Key(Number(-120, 120, "deg"), "Turning of the barb towards the rachis tip.", 0.0),
    "camber": Key(Number(-120, 120, "deg"), "Turning of the barb towards ventral.", 0.0),
}

VANE = {
    "outline": Key(
        Array(Array(Number(-0.5, 1.5), 2, 2), 0, 200),
        "Edge of the vane from base to tip as points [x, y]: x is the share of the vane's "
        "length, y (0 or more) the distance from the rachis as a share of the feather's length. "
        "Empty: no vane on this side.",
    ),
    "guides": Key(
        Array(Table(GUIDE, "table of a guide"), 0, 100),
        "Barb guides in ascending position; barbs in between are interpolated.",
        (),
    ),
}

RACHIS = {
    "diameter_base": Key(Number(1e-5, 0.1, "m"), "Outer diameter at the follicle."),
    "diameter_tip": Key(Number(1e-6, 0.1, "m"), "Outer diameter at the tip."),
    "taper": Key(Number(0.1, 5), "Exponent of the diameter: 1 is a cone, less stays thick.", 1.0),
    "camber": Key(Number(-360, 360, "deg"), "Turning of the shaft towards ventral.", 0.0),
    "sweep": Key(Number(-180, 180, "deg"), "Turning of the shaft towards the trailing side.", 0.0),
    "twist": Key(Number(-180, 180, "deg"), "Turning of the vane about the shaft.", 0.0),
}

FEATHER = {
    "length": Key(Number(1e-3, 5, "m"), "Arc length of the rachis with the calamus."),
    "calamus": Key(Number(0, 0.8), "Share of the length that is bare, from the follicle on.", 0.1),
    "barb_spacing": Key(Number(1e-5, 0.02, "m"), "Distance of real barbs along the rachis.", 5e-4),
    "vane_material": Key(Preset("material/vane"), "Material of both vanes."),
    "rachis_material": Key(Preset("material/rachis"), "Material of the shaft."),
    "rachis": Key(Table(RACHIS, "table"), "Shape of the shaft at rest."),
    "leading": Key(Table(VANE, "table"), "The leading vane."),
    "trailing": Key(Table(VANE, "table"), "The trailing vane."),
}

LOSS = Key(
    Number(0, 2), "Damping: tangent of the loss angle at the feather's first frequency.", 0.1
)

VANE_MATERIAL = {
    "along": Key(Number(1e2, 1e12, "Pa"), "Modulus of the vane along the barbs."),
    "across": Key(Number(0, 1e10, "Pa"), "Modulus across the barbs (barbules)."),
    "shear": Key(Number(0, 1e10, "Pa"), "Shear modulus, against engineering shear."),
    "thickness": Key(Number(1e-6, 0.01, "m"), "Thickness of the vane."),
    "surface_density": Key(Number(1e-5, 10, "kg/m^2"), "Mass of the vane per area."),
    "barb_bending_normal": Key(
        Number(1e-10, 10, "N m"), "Bending stiffness of barbs out of the vane, per metre of vane."
    ),
    "barb_bending_in_plane": Key(
        Number(1e-10, 10, "N m"), "Bending stiffness of barbs within the vane, per metre of vane."
    ),
    "barb_taper": Key(
        Number(0, 5), "Exponent p: both barb stiffnesses fall as (1 - s)^p to the barb's end.", 0.0
    ),
    "bending_across": Key(Number(0, 10, "N m"), "Bending modulus of the vane across the barbs."),
    "loss_factor": LOSS,
    "compression_guard": Key(
        Number(0, 1e12, "Pa"),
        "Modulus of a penalty on lost area, so that the vane wrinkles before it closes; 0: none.",
        0.0,
    ),
    "barb_clamp_normal": Key(
        Number(0, 1e9, "rad/N"),
        "Compliance of the barbs' roots out of the vane: turn under 1 N m per metre of vane; 0: "
        "rigid.",
        0.0,
    ),
    "barb_clamp_in_plane": Key(
        Number(0, 1e9, "rad/N"), "The same for turns of the barbs' roots within the vane.", 0.0
    ),
}

RACHIS_MATERIAL = {
    "young": Key(Number(1e3, 1e12, "Pa"), "Young's modulus of the cortex."),
    "shear": Key(Number(1e3, 1e12, "Pa"), "Shear modulus of the cortex."),
    "wall": Key(Number(0.01, 1), "Share of the radius that is cortex; 1 is solid."),
    "flattening": Key(
        Number(0.05, 20), "Height of the section (across the vane) over its width.", 1.0
    ),
    "cortex_density": Key(Number(1, 2e4, "kg/m^3"), "Density of the cortex."),
    "core_density": Key(Number(0, 2e4, "kg/m^3"), "Density of the core.", 0.0),
    "loss_factor": LOSS,
}

QUALITY = {
    "rows": Key(Number(3, 400, whole=True), "Rows of nodes along the rachis."),
    "columns": Key(Number(1, 100, whole=True), "Nodes along each barb."),
    "coefficients": Key(
        Number(-1, 6, whole=True),
        "Curvature coefficients per barb and direction; 0: rigid barbs, -1: the solver chooses.",
    ),
    "tolerance": Key(Number(1e-9, 0.1, "m"), "Error per frame that the sub-stepping aims at."),
    "max_substeps": Key(Number(1, 4096, whole=True), "Most sub-steps per frame."),
    "radius": Key(
        Number(0, 0.9),
        "Spectral radius of the time integration at infinite frequency: 0 damps at once what a "
        "step does not resolve, 0.9 keeps nearly all of its energy.",
        0.0,
    ),
    "simulated_rows": Key(
        Number(-1, 400, whole=True),
        "Rows that are simulated, at most `rows`, which the meshes have anyhow; 0: all of them, "
        "-1: the solver chooses.",
        0,
    ),
    "coarse_below": Key(
        Number(0, 100, "m"), "Feathers shorter than this get half the rows and columns.", 0.0
    ),
    "rachis_below": Key(
        Number(0, 100, "m"), "Of shorter ones only the shaft is simulated, with rigid barbs.", 0.0
    ),
    "guided_below": Key(
        Number(0, 100, "m"), "Shorter ones follow simulated feathers of their region.", 0.0
    ),
    "guided_every": Key(
        Number(1, 100_000, whole=True),
        "Of feathers that are guided by their length, every n-th of each region is a guide.",
        8,
    ),
    "rigid_below": Key(Number(0, 100, "m"), "Shorter ones follow their roots rigidly.", 0.0),
}

WIND = {
    "direction": Key(Direction(), "Where the wind blows to.", (1.0, 0.0, 0.0)),
    "speed": Key(Number(0, 150, "m/s"), "Speed of the mean wind."),
    "gust": Key(Number(0, 2), "Root mean square of the gusts as a share of the speed.", 0.0),
    "gust_length": Key(Number(0.01, 1000, "m"), "Size of the eddies.", 1.0),
    "air_density": Key(Number(0, 2000, "kg/m^3"), "Density of the air.", 1.225),
    "drag_normal": Key(Number(0, 10), "Force coefficient across the vane.", 1.2),
    "drag_tangential": Key(Number(0, 10), "Force coefficient along the vane.", 0.02),
    "seed": Key(Number(0, 2**31 - 1, whole=True), "Seed of the gusts.", 1),
}

KEYFRAME = {
    "time": Key(Number(-1e4, 1e5, "s"), "Time since the first frame."),
    "joint": Key(Text(empty=True), "Joint that is moved; empty: the whole groom.", ""),
    "position": Key(vector(-1e4, 1e4, "m"), "Displacement from the place at rest.", None),
    "rotation": Key(
        Array(Number(-36000, 36000, "deg"), 3, 4),
        "Rotation against the parent: three angles in degrees (about x, then y, then z), or a "
        "quaternion w, x, y, z. One of position and rotation at least is given.",
        None,
    ),
}


def _angle(meaning: str, default: Any = REQUIRED) -> Key:
    return Key(Number(-180, 180, "deg"), meaning, default)


MOTIONS: dict[str, dict[str, Key]] = {
    "hold": {},
    "shake": {
        "amplitude": Key(Number(0, 100, "m"), "Amplitude of the shake."),
        "frequency": Key(Number(0.001, 1000, "Hz"), "Shakes per second."),
        "direction": Key(Direction(), "Direction of the shake."),
    },
    "flap": {
        "period": Key(Number(0.001, 1000, "s"), "Duration of a wing beat."),
        "beats": Key(Number(0, 1e6), "Beats until the wing rests; 0: no end.", 0.0),
        "shoulder_amplitude": _angle("Half the stroke, about the body's long axis."),
        "shoulder_offset": _angle("Middle of the stroke, positive upwards.", 0.0),
        "shoulder_sweep": _angle("Backward sweep at the top of the stroke.", 0.0),
        "elbow_amplitude": _angle("Half the folding of the elbow.", 0.0),
        "elbow_offset": _angle("Middle of the folding of the elbow.", 0.0),
        "elbow_phase": Key(Number(-1, 1), "Share of a beat by which the elbow lags.", 0.0),
        "wrist_amplitude": _angle("Half the folding of the wrist.", 0.0),
        "wrist_offset": _angle("Middle of the folding of the wrist.", 0.0),
        "wrist_phase": Key(Number(-1, 1), "Share of a beat by which the wrist lags.", 0.0),
        "twist": _angle("Half the turning of the wing about its span.", 0.0),
    },
    "keys": {
        "keyframes": Key(
            Array(Table(KEYFRAME, "table of a keyframe"), 1, 100_000),
            "Keyframes, interpolated smoothly.",
        ),
    },
}

KIND = Key(Text(tuple(MOTIONS)), "Kind of motion; it decides which of the keys below apply.")
MOTION = {"kind": KIND} | {name: key for keys in MOTIONS.values() for name, key in keys.items()}

FAMILIES: dict[str, dict[str, Key]] = {
    "feather": FEATHER,
    "material/vane": VANE_MATERIAL,
    "material/rachis": RACHIS_MATERIAL,
    "quality": QUALITY,
    "wind": WIND,
    "motion": MOTION,
}


def extended(family: str) -> Table:
    """The table of a family's preset file: its keys and `base`."""
    return Table({"base": BASE} | FAMILIES[family], f"{family} preset")


def family_keys(family: str, kind: str = "") -> Table:
    """The keys that a finished preset must have. kind: of a motion."""
    if family == "motion" and kind in MOTIONS:
        return Table({"kind": KIND} | MOTIONS[kind], f"motion of kind {kind}")
    return Table(FAMILIES[family], f"{family} preset")


def names_or_list(item: ValueType, most: int) -> Either:
    """One text, or an array of them."""
    return Either(((is_list, Array(item, 1, most)), (is_text, item)))
