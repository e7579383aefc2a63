"""Every key of what grows in a groom: its skin, regions and layering, wings, tails, birds."""

from __future__ import annotations

from featherfx.groom.keys.anatomy import MAX_ROW_FEATHERS, TAIL_COVERTS
from featherfx.groom.keys.groom import (
    FEATHER_FACTORS,
    LABEL_TEXT,
    MIRROR_KEY,
    PICTURE_KEYS,
    SIZE_FACTOR,
    SURFACE_KEYS,
    VARIANT_KEYS,
)
from featherfx.groom.keys.places import POINT, RADIUS_LENGTH, Direction, Sphere, names_or_list
from featherfx.groom.keys.preset import DIAL_KEYS, FEATHER_KEYS, PRESET_FAMILIES
from featherfx.groom.keys.values import (
    ArrayOf,
    Either,
    Flag,
    Key,
    Number,
    Partial,
    Table,
    Text,
    keys_of,
)
from featherfx.groom.types import Layout

_MAX_SCATTERED = 200_000

LAYOUT_KEYS = keys_of(Layout)

_RANGE = ArrayOf(Number(-1e4, 1e4, "m"), 2, 2)

SKIN_KEYS = {
    "usd": Key(Text(), "USD file that holds the skin, as seen from the groom's folder."),
    "prim": Key(
        Text(),
        "Path of the mesh that regions grow on, where they name no other; or of a Skeleton, for "
        "its space and its joints alone.",
    ),
    "rest": Key(
        Number(-1e9, 1e9),
        "Time code of the pose that is groomed; default: the bind pose of a skinned mesh, the "
        "default values, or the first samples.",
        None,
    ),
    "max_feathers": Key(
        Number(1, 1_000_000, whole=True),
        "Most feathers that all regions may make; a density that asks for more is refused.",
        _MAX_SCATTERED,
    ),
    **VARIANT_KEYS,
    **SURFACE_KEYS,
    **PICTURE_KEYS,
    "colours": Key(
        Text(),
        "Colours of the feathers that grow on it, by where their roots are: a primvar of three "
        "components, such as displayColor, which is linear, or a picture in its texture space "
        "beside the groom, which is sRGB. Over those of a bird, below [overrides].",
        None,
    ),
}

NEAREST_KEYS = {
    "to": Key(ArrayOf(POINT, 1, 1000), "Points."),
    "than": Key(ArrayOf(POINT, 1, 10_000), "The others."),
}

WHERE_KEYS = {
    "primvar": Key(Text(), "Scalar primvar of the skin, 0 to 1.", None),
    "subset": Key(Text(), "GeomSubset of the skin: 1 on its faces, 0 elsewhere.", None),
    "image": Key(
        Text(),
        "Grey picture in the skin's texture space, beside the groom, or a set of tiles with <UDIM> "
        "for their numbers; needs Pillow.",
        None,
    ),
    "box": Key(
        ArrayOf(POINT, 2, 2), "1 within a box, given by its least and greatest corner.", None
    ),
    "sphere": Key(
        Sphere(), "1 within a sphere: [x, y, z, radius], or a table of centre and radius.", None
    ),
    "x": Key(_RANGE, "1 between two values of x.", None),
    "y": Key(_RANGE, "1 between two values of y.", None),
    "z": Key(_RANGE, "1 between two values of z.", None),
    "nearest": Key(
        Table(NEAREST_KEYS), "1 where one of some points is nearer than all of some others.", None
    ),
    "facing": Key(Direction(), "1 where the skin faces a direction, to within `angle`.", None),
    "free_radius": Key(
        RADIUS_LENGTH,
        "1 where a ball of this radius can touch the skin from outside: not in creases, and not "
        "where parts of the body face each other.",
        None,
    ),
    "angle": Key(Number(0, 180, "deg"), "Of `facing`.", 90.0),
    "soft": Key(
        RADIUS_LENGTH,
        "Width over which box, sphere, ranges, nearest and free_radius fade out, inside and out.",
        0.0,
    ),
    "soft_angle": Key(Number(0, 180, "deg"), "Angle over which `facing` fades out.", 20.0),
    "invert": Key(Flag(), "1 becomes 0 and 0 becomes 1.", False),
}

FLOW_KEYS = {
    "direction": Key(Direction(), "Combed along one direction, laid onto the skin.", None),
    "away": Key(
        POINT,
        "Combed away from a point; with `towards`, as a current goes over the skin to there.",
        None,
    ),
    "towards": Key(POINT, "Combed towards a point.", None),
    "primvar": Key(Text(), "Vector primvar of the skin.", None),
    "curves": Key(
        ArrayOf(Text(), 1, 10_000),
        "Paths of guide curves in the skin's file: tangents of the nearest ones, by distance.",
        None,
    ),
    "turn": Key(
        Number(-360, 360, "deg"), "Turned within the skin, counter-clockwise from outside.", 0.0
    ),
}

SPREAD_KEYS = {
    "length": Key(Number(0, 0.3), "Standard deviation of the length, relative.", 0.0),
    "width": Key(Number(0, 0.3), "Standard deviation of the vanes' widths, relative.", 0.0),
    "curl": Key(Number(0, 60, "deg"), "Standard deviation of the curl.", 0.0),
    "tilt": Key(Number(0, 60, "deg"), "Standard deviation of the tilt.", 0.0),
    "turn": Key(Number(0, 60, "deg"), "Standard deviation of the direction within the skin.", 0.0),
    "roll": Key(Number(0, 60, "deg"), "Standard deviation of the roll.", 0.0),
}

REGION_KIND_KEYS = {
    "name": Key(Text(), "Name of a feather preset."),
    "share": Key(Number(0, 1e6), "How much of it there is, against the other kinds.", 1.0),
    "where": Key(
        ArrayOf(Table(WHERE_KEYS), 0, 100),
        "Rules as of a region; the share is multiplied by their product, so maps choose kinds. "
        "Where no kind has a share, the first is taken.",
        (),
    ),
}

_NO_SPREAD = {name: key.default for name, key in SPREAD_KEYS.items()}

REGION_KEYS = {
    "id": Key(Text(), "Start of the ids, and the region's label; a stable number follows."),
    "kind": Key(
        names_or_list(Either({dict: Table(REGION_KIND_KEYS), str: Text()}), 100),
        "Name of a feather preset, or an array of names and tables: kinds that mix, each feather's "
        "drawn by their shares.",
    ),
    "prim": Key(Text(), "Path of the mesh; default: that of [skin].", None),
    "ids_from": Key(
        Text(),
        "USD file of an earlier groom or cache, beside the groom: a feather takes the id of the "
        "one of its region that stood nearest, within their distance from each other.",
        None,
    ),
    "where": Key(
        ArrayOf(Table(WHERE_KEYS), 0, 100),
        "How much of the region there is at a place, 0 to 1: the product of all rules; without any "
        "the whole skin.",
        (),
    ),
    "density": Key(Number(0, 1e9, "1/m^2"), "Feathers per area where the region is whole.", None),
    "count": Key(Number(1, 1_000_000, whole=True), "Feathers in all, instead of density.", None),
    "seed": Key(Number(0, 2**31 - 1, whole=True), "Seed of places and variation.", 1),
    "flow": Key(Table(FLOW_KEYS), "Direction of the shafts along the skin."),
    "length": Key(Number(1e-4, 10, "m"), "Length of the feathers; default: the kind's.", None),
    "max_length_per_free_radius": Key(
        Number(0.01, 100),
        "Feathers are no longer than this many times the radius of the largest ball that touches "
        "the skin there from outside, though no shorter than 0.4 of their length. Of a density "
        "there are as many more as they are shorter.",
        None,
    ),
    "width": Key(Number(0.01, 100), "Factor of the vanes' widths.", 1.0),
    "curl": Key(Number(-360, 360, "deg"), "Added to the camber of the shafts.", 0.0),
    "follow": Key(
        Number(0, 1),
        "How far shafts and barbs bend as the skin beneath them does (1), not as the kind's (0).",
        0.0,
    ),
    "tilt": Key(Number(-90, 90, "deg"), "Angle between the shaft and the skin at the root.", 5.0),
    "roll": Key(
        Number(-360, 360, "deg"),
        "Turning of the root about the shaft; positive lifts the leading vane.",
        0.0,
    ),
    **DIAL_KEYS,
    "blend": Key(
        Flag(),
        "Length, width, curl, tilt and flow pass into those of regions of the same skin where "
        "they overlap, in proportion to how much of each there is.",
        True,
    ),
    "joint": Key(Text(empty=True), "Joint that carries the roots; empty: the groom itself.", ""),
    "side": Key(
        Text(("auto", "left", "right")),
        "Wing that the feathers are shaped for; auto: left where the root is on the left of 0 (y "
        "of the groom, or `left` of [space]).",
        "auto",
    ),
    "variation": Key(Table(SPREAD_KEYS), "Seeded variation.", _NO_SPREAD),
    "variants": Key(
        Number(0, 10_000, whole=True),
        "Different shapes that width and curl vary over, so that feathers repeat and can be "
        "instanced; 0: every feather its own.",
        16,
    ),
    "overrides": Key(
        Partial(Table(FEATHER_KEYS)), "Any key of a feather preset, for this region.", {}
    ),
}


_SKELETON = Key(
    Text(empty=True),
    "Path of a Skeleton in the file of the shot's skin, whose bones fold wings; empty: the shot's "
    "skin, which may be one.",
    "",
)

_UPWARDS = "; default: upwards, whatever the space."
_BACKWARDS = "; default: backwards, as its space has it."

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
    "forward": Key(Direction(), "Where the body looks; default: ahead, as its space has it.", None),
    "up": Key(Direction(), f"The body's upper side{_UPWARDS}", None),
    "scale": Key(
        SIZE_FACTOR,
        "Factor of all lengths of the type; default: by the bones between its landmarks, else 1.",
        None,
    ),
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
    "direction": Key(Direction(), f"Where the tail points{_BACKWARDS}", None),
    "up": Key(Direction(), f"Its upper side{_UPWARDS}", None),
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
    "direction": Key(Direction(), f"Where flat feathers point{_BACKWARDS}", None),
    "up": Key(Direction(), f"Upper side of the head{_UPWARDS}", None),
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
