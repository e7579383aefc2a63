"""Every key of a groom file."""

from __future__ import annotations

from featherfx.groom.keys.anatomy import MOST_IN_A_ROW, TAIL_COVERTS
from featherfx.groom.keys.places import POINT, SPACE, Direction
from featherfx.groom.keys.preset import DIALS, FAMILIES, FEATHER, names_or_list
from featherfx.groom.keys.regions import LAYOUT, REGION, SKIN, WHERE
from featherfx.groom.keys.values import (
    ArrayOf,
    Flag,
    Key,
    Named,
    Number,
    Partial,
    Table,
    Text,
    keys_of,
    tables,
    vector,
)
from featherfx.groom.types import Joint
from featherfx.limits import MOST_FEATHERS

# what a primvar is called where [[usd]] does not say otherwise
DEFAULT_NAMES = {
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

_LABEL = Text(empty=True)
_FACTOR = Number(0.01, 100)
_DIRECTION = Key(Direction(), "Direction of the shaft as it leaves the follicle.", None)
_UP = Key(Direction(), "Dorsal side; need not be square to the direction.", None)

_BELONGS = {
    "region": Key(_LABEL, "Free label, written to USD.", ""),
    "joint": Key(_LABEL, "Joint that carries the root; empty: the groom itself.", ""),
    "side": Key(
        Text(("left", "right")),
        "Wing that the feather belongs to. With x forward, y to the left and z up, a right feather "
        "has its leading vane at +y of its own frame, a left feather at -y.",
        "right",
    ),
}
_MIRROR = Key(
    Text(("x", "y", "z")),
    'Also makes the mirror image at 0 of this axis: "left" and "right" change places in ids and '
    "joints, and side changes.",
    None,
)
_FACTORS = {
    "scale": Key(_FACTOR, "Factor of the size; what follows is told by the kind's `scaling`.", 1.0),
    "width": Key(_FACTOR, "Factor of the vanes' widths.", 1.0),
    "roll": Key(
        Number(-360, 360, "deg"),
        "Turning of the root about the shaft; positive lifts the leading vane.",
        0.0,
    ),
    **DIALS,
}
_SOME_FEATHER_KEYS = Partial(Table(FEATHER))
_KIND = Key(Text(), "Name of a feather preset.")

JOINT = keys_of(Joint) | {"mirror": _MIRROR}

CHANGE = FEATHER | _FACTORS

FEATHER_ENTRY = {
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
    "mirror": _MIRROR,
    **_FACTORS,
    "overrides": Key(
        _SOME_FEATHER_KEYS, "Any key of a feather preset, for this feather alone.", {}
    ),
}

ROOT = {
    "position": Key(POINT, "Place of the follicle."),
    "direction": Key(Direction(), "Direction of the shaft."),
    "up": Key(Direction(), "Dorsal side."),
}

CURVE = {
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

ROW = {
    "id": Key(Text(), "Start of the ids; a number follows (primary_01, primary_02, ...)."),
    "kind": Key(
        names_or_list(Text(), 10_000),
        "Feather preset, or a list of them spread over the row in order.",
    ),
    "blend": Key(
        Flag(), "Pass smoothly from one kind of the list to the next instead of changing.", False
    ),
    "count": Key(Number(1, 100_000, whole=True), "Number of feathers."),
    "first": Key(Table(ROOT, "table of a root"), "Root of the first feather."),
    "last": Key(Table(ROOT, "table of a root"), "Root of the last feather."),
    "path": Key(
        ArrayOf(POINT, 2, 10_000),
        "Polyline that the roots stand on, at equal distances, instead of the straight line from "
        "first.position to last.position.",
        None,
    ),
    "curve": Key(
        Table(CURVE),
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
    "scale": Key(ArrayOf(_FACTOR, 2, 2), "Factors of the size, first and last.", (1.0, 1.0)),
    "width": _FACTORS["width"],
    "roll": _FACTORS["roll"],
    **DIALS,
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
    "layer": REGION["layer"],
    **_BELONGS,
    "mirror": _MIRROR,
    "overrides": Key(_SOME_FEATHER_KEYS, "Any key of a feather preset, for this row.", {}),
}

TABLE = {
    "file": Key(
        Text(),
        "CSV or NPZ file beside the groom. Columns: id, kind, x, y, z, direction_x, "
        "direction_y, direction_z, up_x, up_y, up_z, scale, width, roll, stiffness, weight, "
        "region, joint, side (NPZ: position, direction and up are arrays of three columns). Only "
        "id, the position, the direction and up are needed; the keys below stand for missing "
        "columns.",
    ),
    "kind": Key(Text(), "Feather preset, where there is no column kind.", None),
    **_FACTORS,
    **_BELONGS,
    "mirror": _MIRROR,
}

_SKELETON = Key(
    Text(empty=True),
    "Path of a Skeleton in the file of the shot's skin, whose bones fold wings; empty: the shot's "
    "skin, which may be one.",
    "",
)

WING = {
    "id": Key(Text(), "Start of the ids of its feathers and joints."),
    "type": Key(FAMILIES["wing"], "Wing preset, or a table that starts from one."),
    "shoulder": Key(POINT, "Joint of the wing with the body."),
    "elbow": Key(POINT, "Joint of upper arm and forearm; default: as the type has it.", None),
    "wrist": Key(POINT, "Joint of forearm and hand.", None),
    "tip": Key(POINT, "End of the bones of the hand.", None),
    "fold": Key(
        Number(0, 1),
        "Spread (0) to folded (1), with the bones' lengths of the landmarks, or of the type; "
        "default: the wing is as its landmarks have it.",
        None,
    ),
    "forward": Key(Direction(), "Where the body looks.", (1.0, 0.0, 0.0)),
    "up": Key(Direction(), "The body's upper side.", (0.0, 0.0, 1.0)),
    "scale": Key(_FACTOR, "Factor of all lengths of the type.", 1.0),
    "layer": REGION["layer"],
    "joint": Key(_LABEL, "Joint that carries the shoulder; empty: the groom itself.", ""),
    "side": Key(Text(("left", "right")), "Side of the bird.", "right"),
    "below": Key(Flag(), "Coverts below the wing, too; one that stays folded does without.", True),
    "skeleton": _SKELETON,
    "mirror": _MIRROR,
}

_FAN_LENGTHS = ArrayOf(Number(1e-3, 5, "m"), 1, MOST_IN_A_ROW)
_FAN_ANGLES = ArrayOf(Number(-360, 360, "deg"), 2, 2)

TAIL = {
    "id": Key(Text(), "Start of the ids of its feathers and joints."),
    "position": Key(POINT, "Middle of the roots."),
    "direction": Key(Direction(), "Where the tail points.", (-1.0, 0.0, 0.0)),
    "up": Key(Direction(), "Its upper side.", (0.0, 0.0, 1.0)),
    "kind": Key(Text(), "Feather preset.", "tail_feather"),
    "count": Key(Number(2, MOST_IN_A_ROW, whole=True), "Feathers of both sides.", 12),
    "lengths": Key(_FAN_LENGTHS, "Lengths from the central to the outermost, spread evenly."),
    "width": _FACTORS["width"],
    "root_width": Key(Number(0, 1, "m"), "From the outermost root to the other."),
    "angles": Key(_FAN_ANGLES, "Angle of the whole fan, closed and open.", (10.0, 110.0)),
    "fan": Key(Number(0, 1), "Closed (0) to open (1).", 0.0),
    "roll": Key(Number(-90, 90, "deg"), "Lift of the outermost's leading vane.", 0.0),
    "lift": Key(Number(0, 0.1, "m"), "How much deeper each root is than the next inner.", 8e-4),
    "arch": Key(
        Number(0, 170, "deg"),
        "How far the closed tail is bent to a roof, from edge to edge; open it is flat.",
        0.0,
    ),
    "coverts": Key(
        TAIL_COVERTS, "Rows of coverts; on either side each lies over the one before it.", ()
    ),
    "layer": REGION["layer"],
    "region": Key(_LABEL, "Free label, written to USD.", "tail"),
    "joint": Key(_LABEL, "Joint that carries the tail; empty: the groom itself.", ""),
}

CREST = {
    "id": Key(Text(), "Start of the ids of its feathers and joints."),
    "path": Key(ArrayOf(POINT, 2, 1000), "Polyline of the roots, from front to back."),
    "direction": Key(Direction(), "Where flat feathers point.", (-1.0, 0.0, 0.0)),
    "up": Key(Direction(), "Upper side of the head.", (0.0, 0.0, 1.0)),
    "kind": Key(Text(), "Feather preset.", "body_contour"),
    "count": Key(Number(1, MOST_IN_A_ROW, whole=True), "Number of feathers."),
    "lengths": Key(_FAN_LENGTHS, "Lengths from front to back, spread evenly."),
    "width": _FACTORS["width"],
    "angles": Key(
        _FAN_ANGLES,
        "Angle of the foremost feather above `direction`, flat and raised.",
        (8.0, 80.0),
    ),
    "raise": Key(Number(0, 1), "Flat (0) to raised (1).", 0.0),
    "aside": Key(Number(0, 90, "deg"), "By how much feathers point left and right.", 4.0),
    "roll": Key(Number(-90, 90, "deg"), "Lean of the vanes to either side.", 0.0),
    "layer": REGION["layer"],
    "region": Key(_LABEL, "Free label, written to USD.", "crest"),
    "joint": Key(_LABEL, "Joint that carries the crest; empty: the groom itself.", ""),
}

_WING_LANDMARKS = Key(
    ArrayOf(POINT, 3, 3),
    "Elbow, wrist and tip of the hand's bones, of both wings or of none; default: as the type has "
    "them, by `fold`.",
    None,
)

LANDMARKS = {
    "beak": Key(POINT, "Tip of the beak."),
    "crown": Key(POINT, "Top of the head."),
    "nape": Key(POINT, "Back of the head, where the neck begins."),
    "breast": Key(POINT, "Foremost place of the breast."),
    "right_shoulder": Key(POINT, "Where the right wing leaves the body."),
    "left_shoulder": Key(POINT, "The same of the left wing."),
    "vent": Key(POINT, "Below the tail, between the legs and its root."),
    "tail": Key(POINT, "Root of the tail."),
    "right_wing": _WING_LANDMARKS,
    "left_wing": _WING_LANDMARKS,
    "right_eye": Key(POINT, "Middle of the right eye, for the disc of an owl's face.", None),
    "left_eye": Key(POINT, "The same of the left eye.", None),
    "right_heel": Key(POINT, "Joint below which the right leg is bare.", None),
    "left_heel": Key(POINT, "The same of the left leg.", None),
}

BIRD = {
    "type": Key(FAMILIES["bird"], "Bird preset, or a table that starts from one."),
    "landmarks": Key(Table(LANDMARKS, "table of landmarks"), "Places of the body."),
    "up": Key(
        Direction(),
        "The body's upper side; default: that of the groom's frame, whatever its space.",
        None,
    ),
    "scale": Key(
        _FACTOR,
        "Factor of all lengths of the type; default: that of the distance from beak to tail.",
        None,
    ),
    "fold": Key(Number(0, 1), "Of the wings: spread (0) to folded (1).", 1.0),
    "fan": Key(Number(0, 1), "Of the tail: closed (0) to open (1).", 0.0),
    "raise": Key(Number(0, 1), "Of the crest: flat (0) to raised (1).", 0.0),
    "opens": Key(
        Flag(),
        "Whether folded wings open in a shot: coverts below them, and feathers on the flank.",
        False,
    ),
    "bare": Key(
        ArrayOf(Table(WHERE), 0, 100), "Rules as of a region: where the body has no feathers.", ()
    ),
    "joint": Key(_LABEL, "Joint that carries wings and tail; empty: the groom itself.", ""),
    "skeleton": _SKELETON,
}

USD_NAMES = {name: Key(Text(), "Primvar that holds it.", None) for name in DEFAULT_NAMES}

USD = {
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
        Partial(Table(USD_NAMES)),
        "Primvars by what they hold; default: " + ", ".join(DEFAULT_NAMES.values()) + ".",
        {},
    ),
    **_FACTORS,
    **_BELONGS,
}

VARIATION = {
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
    "variants": Key(
        Number(0, 10_000, whole=True),
        "Different draws of all but length and roll for each region and kind, so that feathers "
        "repeat and can be instanced; 0: every feather its own.",
        0,
    ),
}


GROOM = {
    "name": Key(Text(), "Name of the groom."),
    "space": Key(Table(SPACE), "Axes and unit that the groom is written in.", None),
    "joint": tables(JOINT, "Joints of the skeleton."),
    "feather": tables(FEATHER_ENTRY, "Feathers placed one by one.", most=MOST_FEATHERS),
    "row": tables(ROW, "Rows of feathers."),
    "bird": Key(Table(BIRD), "A whole bird, from landmarks of its body.", None),
    "wing": tables(WING, "Whole wings.", most=1000),
    "tail": tables(TAIL, "Tails that fan.", most=1000),
    "crest": tables(CREST, "Crests that rise.", most=1000),
    "table": tables(TABLE, "Feathers from files, one table or several.", most=1000, single=True),
    "usd": tables(
        USD, "Feathers drawn in USD scenes, one table or several.", most=1000, single=True
    ),
    "skin": Key(Table(SKIN), "Mesh that regions grow on.", None),
    "region": tables(REGION, "Regions of the skin with their feathers."),
    "layout": Key(
        Table(LAYOUT),
        "Lay the feathers over each other like shingles; without it they stay as placed.",
        None,
    ),
    "overrides": Key(
        Named(Partial(Table(CHANGE))),
        'By feather id, with * and ? as wild cards: "primary_*" = { rachis.camber = 5 }. Any key '
        "of a feather preset, and scale, width, stiffness, weight (these multiply) and roll "
        "(adds). Applied in order.",
        {},
    ),
    "variation": Key(Table(VARIATION), "Seeded variation of all feathers.", None),
}

GROOM_FILE = Table(GROOM, "groom")
