"""Every key of a shot file."""

from __future__ import annotations

from featherfx.groom.keys.groom import GROOM, USD
from featherfx.groom.keys.preset import Preset, is_table, is_text, vector
from featherfx.groom.keys.values import Array, Either, Flag, Key, Number, Table, Text

LEVELS = ("full", "coarse", "rachis", "guided", "rigid")

GRIP = {
    "feather": Key(Text(), "Id of the feather."),
    "row": Key(Number(0, 1), "Place along the rachis: 0 the base, 1 the tip.", 1.0),
    "column": Key(Number(0, 1), "Place along the barb: 0 the rachis, 1 the barb's end.", 0.0),
    "side": Key(Text(("leading", "trailing")), "Vane that the barb belongs to.", "leading"),
    "displacement": Key(
        vector(-100, 100, "m"),
        "Way of the gripped point in the groom's frame, from start to end with rest at both.",
    ),
    "start": Key(Number(0, 1e5, "s"), "When the grip starts to move.", 0.0),
    "end": Key(Number(0, 1e5, "s"), "When it has arrived; later than start."),
    "stiffness": Key(Number(1e-6, 1e7, "N/m"), "Stiffness of the spring that leads the point."),
}

FORCE = {
    "feather": Key(Text(), "Id of the feather."),
    "force": Key(
        vector(-1e6, 1e6, "N"),
        "Force in the groom's frame, which the feather does not turn; N/m along a line.",
    ),
    "line": Key(
        Text(("point", "rachis", "barb")),
        "Where it acts: at a point, along the rachis, or along the barb at `row`.",
        "point",
    ),
    "row": Key(Number(0, 1), "Place along the rachis by arc length: 0 the base, 1 the tip.", 1.0),
    "column": Key(Number(0, 1), "Place along the barb: 0 the rachis, 1 the barb's end.", 0.0),
    "side": Key(Text(("leading", "trailing")), "Vane that the barb belongs to.", "leading"),
    "span": Key(
        Array(Number(0, 1), 2, 2), "Of a line: first and last share that it covers.", (0.0, 1.0)
    ),
    "keys": Key(
        Array(Array(Number(-1e6, 1e6), 2, 2), 0, 10_000),
        "[time in s, factor of the force] in ascending time, linear between them and constant "
        "outside. None: the whole force at all times.",
        (),
    ),
}

_SOME_FEATHERS = {
    "feathers": Key(Text(), "Ids, with * and ? as wild cards.", "*"),
    "region": Key(Text(), "Regions, with * and ? as wild cards.", "*"),
    "kind": Key(Text(), "Kinds, with * and ? as wild cards.", "*"),
}

DETAIL = _SOME_FEATHERS | {
    "level": Key(
        Text(LEVELS),
        "full: as the quality says; coarse: half the rows and columns, one coefficient; rachis: "
        "the shaft alone, with rigid barbs; guided: follows simulated feathers of its region; "
        "rigid: not simulated, follows its root.",
    ),
    "every": Key(
        Number(0, 100_000, whole=True),
        "Of guided feathers, every n-th of each region is simulated and guides the others; 0: "
        "only feathers that are simulated anyway guide.",
        8,
    ),
    "spacing": Key(
        Number(1e-6, 100, "m"),
        "Of guided feathers, no more guides than leave none farther from one; `every = 1` lets the "
        "spacing alone decide.",
        None,
    ),
}

SHELTER = _SOME_FEATHERS | {
    "share": Key(
        Number(0, 1),
        "Share of the air's velocity against the roots that the plumage around keeps off: 0 none, "
        "as for a feather that stands alone; 1 all.",
    ),
}

_FILE = Key(Text(), "USD file, as seen from the shot file's folder.")
_START = Key(
    Number(-1e9, 1e9),
    "Time code of the stage at the first frame; default: that of the frame's number.",
    None,
)

GROOM_USD = {"usd": _FILE} | {name: key for name, key in USD.items() if name != "file"}

SKIN = {
    "usd": _FILE,
    "prim": Key(Text(), "Path of the mesh that the roots follow, where a feather names no other."),
    "rest": Key(
        Number(-1e9, 1e9),
        "Time code at which the groom fits the skin; default: the bind pose of a skinned mesh, the "
        "default values, or the first samples.",
        None,
    ),
    "start": _START,
    "tolerance": Key(
        Number(0, 1000, "m"), "Roots that are farther from the skin give a warning.", 0.01
    ),
    "beyond": Key(
        Text(("error", "hold")), "What a shot that is longer than the skin's samples does.", "error"
    ),
}

WIND_USD = {
    "usd": _FILE,
    "prim": Key(Text(), "Path of points with velocities, or of the prim with the attribute."),
    "attribute": Key(
        Text(), "Attribute that holds one vector for the whole space, not a field of points.", None
    ),
    "start": _START,
    "scale": Key(Number(-1e6, 1e6), "Factor of the velocities, in stage units per second.", 1.0),
}

COLLIDER = {
    "usd": _FILE,
    "prims": Key(Array(Text(), 0, 10_000), "Paths, or names with * and ?, of meshes.", ()),
    "collection": Key(Text(), "Collection, such as /Bird.collection:colliders.", None),
    "start": _START,
}

CONTACT = {
    "enabled": Key(Flag(), "Whether feathers touch each other.", True),
    "thickness": Key(
        Number(1e-6, 0.1, "m"),
        "Distance of the middle surfaces of two vanes that touch; default: the vanes' thickness.",
        None,
    ),
    "friction": Key(Number(0, 2), "Coulomb's coefficient of friction.", 0.3),
    "steps": Key(
        Number(0, 10_000, whole=True),
        "Steps per frame that all feathers take together; 0: by the quality's tolerance.",
        0,
    ),
}

LEVEL_OF_DETAIL = {
    "enabled": Key(Flag(), "Whether levels follow what is seen.", True),
    "usd": Key(Text(), "USD file of the camera, as seen from the shot file's folder.", None),
    "prim": Key(Text(), "Path of the camera.", None),
    "start": _START,
    "pixels_per_metre": Key(
        Number(1e-3, 1e9, "1/m"), "Without a camera: all feathers are seen at this scale.", None
    ),
    "image_height": Key(Number(1, 100_000), "Height of the picture in pixels.", 1080.0),
    "coarse_below": Key(
        Number(0, 1e6), "Feathers shorter than this in the picture, in pixels, are coarse.", 80.0
    ),
    "rachis_below": Key(Number(0, 1e6), "Of shorter ones only the shaft is simulated.", 0.0),
    "guided_below": Key(
        Number(0, 1e6), "Shorter ones follow simulated feathers of their region.", 30.0
    ),
    "rigid_below": Key(Number(0, 1e6), "Shorter ones follow their roots.", 6.0),
    "outside": Key(Text(LEVELS), "Level of feathers outside the picture.", "rigid"),
    "margin": Key(Number(0, 10), "Share of the picture by which it is widened on every side.", 0.1),
    "motion": Key(
        Number(0, 100),
        "Sizes count 1 + this times the acceleration of root or tip, in gravities; 0: only what is "
        "seen counts.",
        0.5,
    ),
    "fade": Key(
        Number(1, 1000, whole=True),
        "Frames that a change takes at least, and that a finer level is there before it is needed.",
        8,
    ),
}

SHOT = {
    "name": Key(Text(), "Name of the shot."),
    "groom": Key(
        Either(((is_table, Table(GROOM_USD, "table")), (is_text, Text()))),
        "Groom file, TOML or USD, as seen from the shot file's folder, or a table that says what "
        "to read of a USD file.",
    ),
    "overrides": GROOM["overrides"],
    "skin": Key(Table(SKIN, "table"), "Animated skin that moves the roots.", None),
    "frames": Key(
        Array(Number(-1_000_000, 1_000_000, whole=True), 2, 2), "First and last frame, both baked."
    ),
    "frames_per_second": Key(Number(1, 1000, "1/s"), "Frames per second.", 24.0),
    "motion": Key(
        Preset("motion"), "Motion of the roots: a preset, or a table with or without base.", "hold"
    ),
    "wind": Key(Preset("wind"), "Wind: a preset, or a table with or without base.", "calm"),
    "quality": Key(
        Preset("quality"), "Resolution: a preset, or a table with or without base.", "preview"
    ),
    "gravity": Key(vector(-1000, 1000, "m/s^2"), "Acceleration of free fall.", (0.0, 0.0, -9.81)),
    "sleep": Key(
        Flag(),
        "Whether feathers at rest are skipped until root, wind, grip or force wakes them.",
        True,
    ),
    "coast": Key(
        Flag(),
        "Whether feathers at rest against a root that moves evenly on a straight line are carried "
        "along unstepped; needs `sleep`.",
        True,
    ),
    "cycle": Key(
        Number(0, 1_000_000, "frames", whole=True),
        "Frames after which root, wind, grips and forces repeat: once a feather's motion has "
        "become periodic to within the quality's tolerance, it is replayed instead of stepped. 0: "
        "never.",
        0,
    ),
    "settle": Key(
        Flag(), "Whether feathers hang in balance at the first frame, instead of at rest.", True
    ),
    "wind_usd": Key(Table(WIND_USD, "table"), "Wind of a USD scene, added to `wind`.", None),
    "contact": Key(
        Table(CONTACT, "table"), "Contact of feathers with each other and colliders.", None
    ),
    "collider": Key(Array(Table(COLLIDER, "table"), 0, 10_000), "Meshes of USD scenes.", ()),
    "grip": Key(Array(Table(GRIP, "table"), 0, 10_000), "Points led along a path.", ()),
    "detail": Key(
        Array(Table(DETAIL, "table"), 0, 10_000),
        "Level of detail by feather, before the quality's lengths; the last one that fits holds.",
        (),
    ),
    "shelter": Key(
        Array(Table(SHELTER, "table"), 0, 10_000),
        "Which feathers the wind reaches less, because they lie within plumage; the last one that "
        "fits holds.",
        (),
    ),
    "level_of_detail": Key(
        Table(LEVEL_OF_DETAIL, "table"), "Levels of detail by frame, from what is seen.", None
    ),
    "force": Key(Array(Table(FORCE, "table"), 0, 10_000), "Dead forces on points and lines.", ()),
}

SHOT_FILE = Table(SHOT, "shot")
