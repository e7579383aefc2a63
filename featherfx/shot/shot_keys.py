"""Every key of a shot file."""

from __future__ import annotations

from featherfx.groom.preset_keys import Preset, vector
from featherfx.groom.schema import Array, Flag, Key, Number, Table, Text

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

SHOT = {
    "name": Key(Text(), "Name of the shot."),
    "groom": Key(Text(), "Groom file, as seen from the shot file's folder."),
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
    "settle": Key(
        Flag(), "Whether feathers hang in balance at the first frame, instead of at rest.", True
    ),
    "grip": Key(Array(Table(GRIP, "table"), 0, 10_000), "Points led along a path.", ()),
}

SHOT_FILE = Table(SHOT, "shot")
