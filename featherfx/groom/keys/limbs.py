"""Keys of wings, tails, crests and birds in groom files."""

from __future__ import annotations

from featherfx.groom.keys.anatomy import MAX_ROW_FEATHERS, TAIL_COVERTS
from featherfx.groom.keys.groom import FEATHER_FACTORS, LABEL_TEXT, MIRROR_KEY, SIZE_FACTOR
from featherfx.groom.keys.places import POINT, Direction
from featherfx.groom.keys.preset import PRESET_FAMILIES
from featherfx.groom.keys.regions import WHERE_KEYS
from featherfx.groom.keys.values import ArrayOf, Flag, Key, Number, Table, Text

_SKELETON = Key(
    Text(empty=True),
    "Path of a Skeleton in the file of the shot's skin, whose bones fold wings; empty: the shot's "
    "skin, which may be one.",
    "",
)

WING_KEYS = {
    "id": Key(Text(), "Start of the ids of its feathers and joints."),
    "type": Key(PRESET_FAMILIES["wing"], "Wing preset, or a table that starts from one."),
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
    "scale": Key(SIZE_FACTOR, "Factor of all lengths of the type.", 1.0),
    "joint": Key(LABEL_TEXT, "Joint that carries the shoulder; empty: the groom itself.", ""),
    "side": Key(Text(("left", "right")), "Side of the bird.", "right"),
    "below": Key(Flag(), "Coverts below the wing, too; one that stays folded does without.", True),
    "skeleton": _SKELETON,
    "mirror": MIRROR_KEY,
}

_FAN_LENGTHS = ArrayOf(Number(1e-3, 5, "m"), 1, MAX_ROW_FEATHERS)
_FAN_ANGLES = ArrayOf(Number(-360, 360, "deg"), 2, 2)

TAIL_KEYS = {
    "id": Key(Text(), "Start of the ids of its feathers and joints."),
    "position": Key(POINT, "Middle of the roots."),
    "direction": Key(Direction(), "Where the tail points.", (-1.0, 0.0, 0.0)),
    "up": Key(Direction(), "Its upper side.", (0.0, 0.0, 1.0)),
    "kind": Key(Text(), "Feather preset.", "tail_feather"),
    "count": Key(Number(2, MAX_ROW_FEATHERS, whole=True), "Feathers of both sides.", 12),
    "lengths": Key(_FAN_LENGTHS, "Lengths from the central to the outermost, spread evenly."),
    "width": FEATHER_FACTORS["width"],
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
    "region": Key(LABEL_TEXT, "Free label, written to USD.", "tail"),
    "joint": Key(LABEL_TEXT, "Joint that carries the tail; empty: the groom itself.", ""),
}

CREST_KEYS = {
    "id": Key(Text(), "Start of the ids of its feathers and joints."),
    "path": Key(ArrayOf(POINT, 2, 1000), "Polyline of the roots, from front to back."),
    "direction": Key(Direction(), "Where flat feathers point.", (-1.0, 0.0, 0.0)),
    "up": Key(Direction(), "Upper side of the head.", (0.0, 0.0, 1.0)),
    "kind": Key(Text(), "Feather preset.", "body_contour"),
    "count": Key(Number(1, MAX_ROW_FEATHERS, whole=True), "Number of feathers."),
    "lengths": Key(_FAN_LENGTHS, "Lengths from front to back, spread evenly."),
    "width": FEATHER_FACTORS["width"],
    "angles": Key(
        _FAN_ANGLES,
        "Angle of the foremost feather above `direction`, flat and raised.",
        (8.0, 80.0),
    ),
    "raise": Key(Number(0, 1), "Flat (0) to raised (1).", 0.0),
    "aside": Key(Number(0, 90, "deg"), "By how much feathers point left and right.", 4.0),
    "roll": Key(Number(-90, 90, "deg"), "Lean of the vanes to either side.", 0.0),
    "region": Key(LABEL_TEXT, "Free label, written to USD.", "crest"),
    "joint": Key(LABEL_TEXT, "Joint that carries the crest; empty: the groom itself.", ""),
}

_WING_LANDMARKS = Key(
    ArrayOf(POINT, 3, 3),
    "Elbow, wrist and tip of the hand's bones, of both wings or of none; default: as the type has "
    "them, by `fold`.",
    None,
)

LANDMARK_KEYS = {
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

BIRD_KEYS = {
    "type": Key(PRESET_FAMILIES["bird"], "Bird preset, or a table that starts from one."),
    "landmarks": Key(Table(LANDMARK_KEYS, "table of landmarks"), "Places of the body."),
    "up": Key(
        Direction(),
        "The body's upper side; default: that of the groom's frame, whatever its space.",
        None,
    ),
    "scale": Key(
        SIZE_FACTOR,
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
        ArrayOf(Table(WHERE_KEYS), 0, 100),
        "Rules as of a region: where the body has no feathers.",
        (),
    ),
    "joint": Key(LABEL_TEXT, "Joint that carries wings and tail; empty: the groom itself.", ""),
    "skeleton": _SKELETON,
}
