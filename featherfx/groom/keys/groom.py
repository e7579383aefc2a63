"""Every key of a groom file."""

from __future__ import annotations

from featherfx.groom.keys.places import (
    POINT,
    SPACE_KEYS,
    Direction,
    LazyKeys,
    Named,
    TextsByName,
    names_or_list,
)
from featherfx.groom.keys.preset import DIAL_KEYS, FEATHER_KEYS
from featherfx.groom.keys.values import (
    ArrayOf,
    Flag,
    Key,
    Number,
    Partial,
    Table,
    Text,
    keys_of,
    tables,
    vector,
)
from featherfx.groom.types import Joint
from featherfx.limits import MAX_FEATHERS

_PURPOSES = ("default", "render", "proxy", "guide")

VARIANT_KEYS = {
    "variant_sets": Key(
        TextsByName(),
        'Variants to choose, by variant set: { look = "bird" }; default: those of the stage.',
        {},
    )
}
SURFACE_KEYS = {
    "subdivision": Key(
        Flag(), "Whether a mesh is the subdivided surface that renderers draw, or its cage.", True
    )
}
PICTURE_KEYS = {
    "uv": Key(Text(), "Primvar of the mesh that holds texture coordinates.", "st"),
    "wrap": Key(
        Text(("black", "clamp", "repeat", "mirror")),
        "Pictures outside of 0 to 1: 0, their edge, again, or again turned round. A name with "
        "<UDIM> is a set of tiles, outside of which is 0.",
        "black",
    ),
}
DRAWN_KEYS = VARIANT_KEYS | {
    "purposes": Key(
        ArrayOf(Text(_PURPOSES), 1, len(_PURPOSES)),
        "Purposes of the prims that are read where no path names them.",
        ("default", "render"),
    ),
    "invisible": Key(
        Flag(), "Whether invisible prims are read, too, where no path names them.", False
    ),
}


# what a primvar is called where [[usd]] does not say otherwise
DEFAULT_PRIMVARS = {
    "id": "featherId",
    "kind": "featherKind",
    "region": "region",
    "up": "up",
    "frame": "frame",
    "scale": "lengthScale",
    "skin": "skinPrim",
    "skin_uv": "skinUV",
    "left_barbs": "P_barbl",
    "right_barbs": "P_barbr",
}

LABEL_TEXT = Text(empty=True)
SIZE_FACTOR = Number(0.01, 100)
_DIRECTION = Key(Direction(), "Direction of the shaft as it leaves the follicle.", None)
_UP = Key(Direction(), "Dorsal side; need not be square to the direction.", None)

_BELONGS = {
    "region": Key(LABEL_TEXT, "Free label, written to USD.", ""),
    "joint": Key(LABEL_TEXT, "Joint that carries the root; empty: the groom itself.", ""),
    "side": Key(
        Text(("left", "right")),
        "Wing that the feather belongs to. With x forward, y to the left and z up, a right feather "
        "has its leading vane at +y of its own frame, a left feather at -y.",
        "right",
    ),
}
MIRROR_KEY = Key(
    Text(("x", "y", "z")),
    'Also makes the mirror image at 0 of this axis: "left" and "right" change places in ids and '
    "joints, and side changes.",
    None,
)
FEATHER_FACTORS = {
    "scale": Key(
        SIZE_FACTOR, "Factor of the size; what follows is told by the kind's `scaling`.", 1.0
    ),
    "width": Key(SIZE_FACTOR, "Factor of the vanes' widths.", 1.0),
    "roll": Key(
        Number(-360, 360, "deg"),
        "Turning of the root about the shaft; positive lifts the leading vane.",
        0.0,
    ),
    **DIAL_KEYS,
}
_SOME_FEATHER_KEYS = Partial(Table(FEATHER_KEYS))
_KIND = Key(Text(), "Name of a feather preset.")

JOINT_KEYS = keys_of(Joint) | {"mirror": MIRROR_KEY}

_CHANGE_KEYS = FEATHER_KEYS | FEATHER_FACTORS

FEATHER_ENTRY_KEYS = {
    "id": Key(Text(), "Name, unique in the groom."),
    "kind": _KIND,
    "position": Key(POINT, "Place of the follicle."),
    "direction": _DIRECTION,
    "up": _UP,
    "rotation": Key(
        vector(-36000, 36000, "deg"),
        "Instead of direction and up: angles about x, then y, then z. Without either, the "
        "feather's frame is the groom's.",
        None,
    ),
    **_BELONGS,
    "mirror": MIRROR_KEY,
    **FEATHER_FACTORS,
    "overrides": Key(
        _SOME_FEATHER_KEYS, "Any key of a feather preset, for this feather alone.", {}
    ),
}

ROOT_KEYS = {
    "position": Key(POINT, "Place of the follicle."),
    "direction": Key(Direction(), "Direction of the shaft."),
    "up": Key(Direction(), "Dorsal side."),
}

_CURVE_KEYS = {
    "usd": Key(Text(), "USD file, as seen from the groom's folder."),
    "prim": Key(Text(), "Path of the BasisCurves, which hold one curve, or of a Skeleton."),
    "joints": Key(
        ArrayOf(Text(), 0, 10_000),
        "Joints of the Skeleton, by path or last name: the roots stand on the straight lines from "
        "one to the next, in the bind pose.",
        (),
    ),
    "tail": Key(
        Flag(),
        "Of joints: the row goes on to the end of the last one's bone, the joint below it or the "
        "end of the skin that it moves.",
        True,
    ),
}

ROW_KEYS = {
    "id": Key(Text(), "Start of the ids; a number follows (primary_01, primary_02, ...)."),
    "kind": Key(
        names_or_list(Text(), 10_000),
        "Feather preset, or a list of them spread over the row in order.",
    ),
    "blend": Key(
        Flag(), "Pass smoothly from one kind of the list to the next instead of changing.", False
    ),
    "count": Key(Number(1, 100_000, whole=True), "Number of feathers."),
    "first": Key(Table(ROOT_KEYS, "table of a root"), "Root of the first feather."),
    "last": Key(Table(ROOT_KEYS, "table of a root"), "Root of the last feather."),
    "path": Key(
        ArrayOf(POINT, 2, 10_000),
        "Polyline that the roots stand on, at equal distances, instead of the straight line from "
        "first.position to last.position.",
        None,
    ),
    "curve": Key(
        Table(_CURVE_KEYS),
        "A curve of a USD file that the roots stand on, at equal distances, as a bone or the edge "
        "of a wing, instead of `path`.",
        None,
    ),
    "turn_with_path": Key(
        Flag(),
        "Roots turn with the curve or path that they stand on, from the first to the last, besides "
        "what their frames differ in; otherwise they turn evenly from the one to the other.",
        False,
    ),
    "scale": Key(ArrayOf(SIZE_FACTOR, 2, 2), "Factors of the size, first and last.", (1.0, 1.0)),
    "width": FEATHER_FACTORS["width"],
    "roll": FEATHER_FACTORS["roll"],
    **DIAL_KEYS,
    "lift": Key(
        Number(-0.1, 0.1, "m"),
        "Lift of each root over the one before it, so that neighbours lie like shingles.",
        0.0,
    ),
    "spacing": Key(
        Number(0.01, 100),
        "Distance of the last two roots over that of the first two; between, it changes evenly.",
        1.0,
    ),
    **_BELONGS,
    "mirror": MIRROR_KEY,
    "overrides": Key(_SOME_FEATHER_KEYS, "Any key of a feather preset, for this row.", {}),
}

TABLE_KEYS = {
    "file": Key(
        Text(),
        "CSV or NPZ file beside the groom. Columns: id, kind, x, y, z, direction_x, "
        "direction_y, direction_z, up_x, up_y, up_z, scale, width, roll, stiffness, weight, "
        "region, joint, side (NPZ: position, direction and up are arrays of three columns). Only "
        "id, the position, the direction and up are needed; the keys below stand for missing "
        "columns.",
    ),
    "kind": Key(Text(), "Feather preset, where there is no column kind.", None),
    **FEATHER_FACTORS,
    **_BELONGS,
    "mirror": MIRROR_KEY,
}

USD_NAME_KEYS = {name: Key(Text(), "Primvar that holds it.", None) for name in DEFAULT_PRIMVARS}

USD_KEYS = {
    "file": Key(Text(), "USD file beside the groom: curves, condensed feathers, instancers."),
    "prims": Key(
        ArrayOf(Text(), 0, 10_000),
        "Paths of the prims to read, with all below them; empty: the whole stage.",
        (),
    ),
    "kind": Key(Text(), "Feather preset, where no primvar names one.", None),
    "shape": Key(
        Text(("curve", "kind")),
        "Whether camber and sweep follow the drawn curve or stay the kind's. The length is always "
        "the curve's.",
        "curve",
    ),
    "up": Key(Direction(), "Dorsal side in the groom's frame, where no primvar gives it.", None),
    "time": Key(
        Number(-1e9, 1e9),
        "Time code to read at; default: the default values, or the first samples where there are "
        "none.",
        None,
    ),
    "names": Key(
        Partial(Table(USD_NAME_KEYS)),
        "Primvars by what they hold; default: " + ", ".join(DEFAULT_PRIMVARS.values()) + ".",
        {},
    ),
    **DRAWN_KEYS,
    **FEATHER_FACTORS,
    **_BELONGS,
}

VARIATION_KEYS = {
    "seed": Key(Number(0, 2**31 - 1, whole=True), "Seed; each feather draws by seed and id.", 1),
    "length": Key(Number(0, 0.3), "Standard deviation of the size, relative.", 0.0),
    "width": Key(Number(0, 0.3), "Standard deviation of the vanes' widths, relative.", 0.0),
    "camber": Key(Number(0, 60, "deg"), "Standard deviation of the shaft's camber.", 0.0),
    "roll": Key(Number(0, 60, "deg"), "Standard deviation of the roots' roll.", 0.0),
    "barb_angle": Key(Number(0, 15, "deg"), "Standard deviation of all barb angles together.", 0.0),
    "modulus_across_barbs": Key(
        Number(0, 0.3),
        "Standard deviation of the vane's moduli across and in shear, relative.",
        0.0,
    ),
    "modulus_along_barbs": Key(
        Number(0, 0.3),
        "Standard deviation of the vane's modulus along and of barbs' stiffness.",
        0.0,
    ),
    "thickness": Key(Number(0, 0.3), "Standard deviation of the vane's thickness, relative.", 0.0),
    "stiffness": Key(Number(0, 0.3), "Standard deviation of all stiffnesses, relative.", 0.0),
    "weight": Key(
        Number(0, 0.3),
        "Standard deviation of all masses, relative; inner primaries of two wings were weighed "
        "within 0.04 and 0.06 of the law of their lengths.",
        0.0,
    ),
    "variants": Key(
        Number(0, 10_000, whole=True),
        "Different draws of all but length and roll for each region and kind, so that feathers "
        "repeat and can be instanced; 0: every feather its own.",
        0,
    ),
}


# module of the keys that only grooms with these tables load
_PLUMAGE = "featherfx.groom.keys.plumage"

GROOM_KEYS = {
    "name": Key(Text(), "Name of the groom."),
    "space": Key(Table(SPACE_KEYS), "Axes and unit that the groom is written in.", None),
    "drawn_pose": Key(
        Text(("unloaded", "equilibrium")),
        "Whether feathers have the shape that is drawn without any load, and hang lower under "
        "gravity, or in balance under the groom's `gravity`: then the unloaded shape of each that "
        "leads to it is found, and a warning names those that have none.",
        "unloaded",
    ),
    "gravity": Key(
        vector(-1000, 1000, "m/s^2"),
        "Acceleration of free fall in which the drawn pose is the balance, in the groom's frame.",
        (0.0, 0.0, -9.81),
    ),
    "joint": tables(JOINT_KEYS, "Joints of the skeleton."),
    "feather": tables(FEATHER_ENTRY_KEYS, "Feathers placed one by one.", most=MAX_FEATHERS),
    "row": tables(ROW_KEYS, "Rows of feathers."),
    "bird": Key(
        Table(LazyKeys(_PLUMAGE, "BIRD_KEYS")), "A whole bird, from landmarks of its body.", None
    ),
    "wing": tables(LazyKeys(_PLUMAGE, "WING_KEYS"), "Whole wings.", most=1000),
    "tail": tables(LazyKeys(_PLUMAGE, "TAIL_KEYS"), "Tails that fan.", most=1000),
    "crest": tables(LazyKeys(_PLUMAGE, "CREST_KEYS"), "Crests that rise.", most=1000),
    "table": tables(
        TABLE_KEYS, "Feathers from files, one table or several.", most=1000, single=True
    ),
    "usd": tables(
        USD_KEYS, "Feathers drawn in USD scenes, one table or several.", most=1000, single=True
    ),
    "skin": Key(Table(LazyKeys(_PLUMAGE, "SKIN_KEYS")), "Mesh that regions grow on.", None),
    "region": tables(LazyKeys(_PLUMAGE, "REGION_KEYS"), "Regions of the skin with their feathers."),
    "layout": Key(
        Table(LazyKeys(_PLUMAGE, "LAYOUT_KEYS")),
        "Lay the feathers over each other like shingles; without it they stay as placed.",
        None,
    ),
    "overrides": Key(
        Named(Partial(Table(_CHANGE_KEYS))),
        'By feather id, with * and ? as wild cards: "primary_*" = { rachis.camber = 5 }. Any key '
        "of a feather preset, and scale, width, stiffness, weight (these multiply) and roll "
        "(adds). Applied in order.",
        {},
    ),
    "variation": Key(Table(VARIATION_KEYS), "Seeded variation of all feathers.", None),
}

GROOM_FILE = Table(GROOM_KEYS, "groom")
