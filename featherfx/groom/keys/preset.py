"""Keys of presets by family: feathers, materials, qualities, winds and motions."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated, Any

from featherfx.algebra.types import Array, ByValue
from featherfx.groom.keys.places import Direction, LazyKeys, PartPreset, Preset, TextsByName
from featherfx.groom.keys.values import (
    REQUIRED,
    ArrayOf,
    Default,
    Either,
    Flag,
    Key,
    Number,
    Table,
    Text,
    keys_of,
    vector,
)
from featherfx.groom.materials import RachisMaterial, VaneMaterial
from featherfx.groom.types import FeatherKind

_LENGTH = Number(0, 100, "m")
_DEFAULT_ERROR = 0.5  # percent


@dataclass(frozen=True)
class Quality:
    """Resolution and accuracy of feathers.

    rows, columns: of the meshes and, without error, of what is simulated.
    """

    name: str
    rows: Annotated[int, Number(3, 400, whole=True), "Rows of nodes along the rachis."] = 21
    columns: Annotated[int, Number(1, 100, whole=True), "Nodes along each barb."] = 6
    coefficients: Annotated[
        int,
        Number(-1, 6, whole=True),
        "Curvature coefficients per barb and direction, no more than columns; 0: rigid barbs, -1: "
        "the solver chooses.",
    ] = -1
    tolerance: Annotated[
        float | None,
        Number(1e-9, 0.1, "m"),
        "Local error that a sub-step may have: a step with more is taken again in shorter ones, "
        "as long as there are no more than `max_substeps`. Errors of steps add up: a tolerance "
        "four times smaller about halves what a trajectory errs by. Default: by `error`, for each "
        "feather.",
    ] = None
    relative_tolerance: Annotated[
        float,
        Number(1e-6, 1),
        "What `tolerance` is at most, over the length of each feather, so that one for feathers of "
        "all lengths does not let small ones err by much of theirs. Where feathers push each "
        "other, `tolerance` holds for all as it is.",
    ] = 0.01
    error: Annotated[
        float | None,
        Number(0.01, 20, "%"),
        "How far any point of a feather may be off, in percent of its length. Of each feather as "
        "many rows, columns and coefficients are simulated, in such steps, as that takes; "
        "`coefficients`, `tolerance` and `simulated_rows` overrule it. Default: 0.5 where there is "
        "no `tolerance`, else nothing is promised.",
    ] = None
    contact_tolerance: Annotated[
        float | None,
        Number(1e-9, 0.1, "m"),
        "`tolerance` where feathers push each other, as these take common steps. No `error` is "
        "promised then; in coats it still chooses rows and columns. Default: as elsewhere.",
    ] = None
    max_substeps: Annotated[
        int,
        Number(1, 20_000, whole=True),
        "Most sub-steps per frame, a bound on work: half of them may be as short as their errors "
        "ask, the others share what is left of the frame. Where feathers touch, `max_steps` of "
        "`[contact]` at most.",
    ] = 20_000
    spectral_radius: Annotated[
        float,
        Number(0, 0.8),
        "Spectral radius of the time integration at infinite frequency: 0 damps at once what a "
        "step does not resolve, 0.8 keeps most of its energy. Beyond, fine grids become unstable.",
    ] = 0.5
    simulated_rows: Annotated[
        int,
        Number(-1, 400, whole=True),
        "Rows that are simulated, at most `rows`, which the meshes have anyhow; 0: all of them, or "
        "by `error`, -1: the solver chooses.",
    ] = 0
    simulated_columns: Annotated[
        int,
        Number(0, 100, whole=True),
        "Nodes along each barb that are simulated, at most `columns`, which the meshes have "
        "anyhow; 0: all of them, or by `error`.",
    ] = 0
    coarse_below: Annotated[
        float, _LENGTH, "Feathers shorter than this get half the rows and columns."
    ] = 0.0
    rachis_below: Annotated[
        float, _LENGTH, "Of shorter ones only the shaft is simulated, with rigid barbs."
    ] = 0.0
    guided_below: Annotated[
        float, _LENGTH, "Shorter ones follow simulated feathers of their region."
    ] = 0.0
    guided_every: Annotated[
        int,
        Number(1, 100_000, whole=True),
        "Of feathers that are guided by their length, every n-th of each region is a guide.",
    ] = 8
    rigid_below: Annotated[float, _LENGTH, "Shorter ones follow their roots rigidly."] = 0.0
    body_size: Annotated[
        float,
        Number(0, 1e4, "m"),
        "Size of the body that these four lengths are for, the diagonal of the box around its "
        "skin, else around all roots; on larger and smaller bodies they are longer and shorter in "
        "proportion. 0: they hold as they are.",
    ] = 0.0

    @property
    def own_columns(self) -> int:
        """Nodes along each barb that are simulated, where no error is promised."""
        return min(self.simulated_columns or self.columns, self.columns)

    @property
    def promised(self) -> float | None:
        """The error, share of a feather's length, that is promised; None: none is."""
        if self.error is None:
            return None if self.tolerance else _DEFAULT_ERROR / 100.0
        return self.error / 100.0

    def on_grid(self, rows: int, columns: int, coefficients: int, **others: Any) -> Quality:
        """Return one that simulates every feather in full, on this grid; others: more keys."""
        own = replace(self, coarse_below=0.0, rachis_below=0.0, guided_below=0.0, rigid_below=0.0)
        own = replace(own, error=None, simulated_rows=0, simulated_columns=0)
        return replace(own, rows=rows, columns=columns, coefficients=coefficients, **others)

    @property
    def pushing(self) -> Quality:
        """The quality of feathers that push each other."""
        if self.contact_tolerance is None:
            return self
        return replace(self, error=None, tolerance=self.tolerance or self.contact_tolerance)

    def with_error(self, error: float) -> Quality:
        """The same meshes, and what is simulated by an error in percent alone."""
        return replace(
            self,
            error=error,
            tolerance=None,
            contact_tolerance=None,
            coefficients=-1,
            simulated_rows=0,
            simulated_columns=0,
        )


@dataclass(frozen=True, eq=False)
class Wind(ByValue):
    """A wind field: a mean wind with seeded gusts that travel with it. direction: (3,) unit."""

    direction: Annotated[Array, Direction(), "Where the wind blows to.", Default((1.0, 0.0, 0.0))]
    speed: Annotated[float, Number(0, 150, "m/s"), "Speed of the mean wind."]
    gust: Annotated[
        float, Number(0, 2), "Root mean square of the gusts as a share of the speed."
    ] = 0.0
    gust_length: Annotated[float, Number(0.01, 1000, "m"), "Size of the eddies."] = 1.0
    air_density: Annotated[float, Number(0, 2000, "kg/m^3"), "Density of the air."] = 1.225
    drag_normal: Annotated[float, Number(0, 10), "Force coefficient across the vane."] = 1.2
    drag_tangential: Annotated[float, Number(0, 10), "Force coefficient along the vane."] = 0.02
    seed: Annotated[int, Number(0, 2**31 - 1, whole=True), "Seed of the gusts."] = 1
    added_mass: Annotated[
        bool, "Whether vanes carry the air beside them, which slows them down as more mass would."
    ] = True


@dataclass(frozen=True)
class Clock:
    """When and how much of a motion there is. amount: (time, share) pairs."""

    start: Annotated[
        float, Number(-1e4, 1e5, "s"), "When the motion's own time begins, since the first frame."
    ] = 0.0
    tempo: Annotated[float, Number(1e-3, 1e3), "How many times faster its own time goes."] = 1.0
    size: Annotated[
        float, Number(1e-3, 1e3), "How many times as far ways go, of the groom and of joints."
    ] = 1.0
    fit: Annotated[
        str,
        Text(("none", "body", "beat")),
        "`body` or `beat`: of a bird that is `size` times as long as a pigeon, of its skin or else "
        "its wings, ways go so much farther, and time 1 / sqrt(size) times as fast, or as its "
        "wings beat; `tempo` and `size` are factors of that.",
    ] = "none"
    amount: Annotated[
        tuple[tuple[float, float], ...],
        ArrayOf(ArrayOf(Number(-1e5, 1e5), 2, 2), 1, 10_000),
        "[time, amount] in ascending seconds of its own time, 0 (none) to 2: turns and ways of "
        "joints count by so much; smooth between, constant outside.",
    ] = ((0.0, 1.0),)


UNSCALED_CLOCK = Clock()

_DIAL = Number(1e-3, 1e3)
DIAL_KEYS = {
    "stiffness": Key(
        _DIAL,
        "Factor of all stiffnesses together: shaft, barbs, vane and its bending. Frequencies go as "
        "its root.",
        1.0,
    ),
    "weight": Key(_DIAL, "Factor of all masses together: shaft and vane.", 1.0),
}

FEATHER_KEYS = keys_of(FeatherKind) | DIAL_KEYS

KEYFRAME_KEYS = {
    "time": Key(Number(-1e4, 1e5, "s"), "Time since the first frame."),
    "joint": Key(
        Text(empty=True), "Joint that moves, with * and ? as wild cards; empty: the groom.", ""
    ),
    "position": Key(vector(-1e4, 1e4, "m"), "Displacement from the place at rest.", None),
    "rotation": Key(
        ArrayOf(Number(-36000, 36000, "deg"), 3, 4),
        "Rotation against the parent: angles about x, y and z in degrees, which count turns, or a "
        "quaternion w, x, y, z, which takes the shortest way. One of position and rotation at "
        "least is given.",
        None,
    ),
    "order": Key(
        Text(("xyz", "xzy", "yxz", "yzx", "zxy", "zyx")),
        "Order in which a joint's angles turn it, about fixed axes; the same at all its keyframes.",
        "xyz",
    ),
    "tangents": Key(
        Either(
            {
                str: Text(("smooth", "linear", "step", "flat")),
                list: ArrayOf(Number(-1e6, 1e6, "m/s or deg/s"), 3, 3),
            }
        ),
        "How curves pass the keyframe: smooth without overshoot, straight to both neighbours, held "
        "until the next, at rest, or at three rates: of the position or of the rotation, whichever "
        "the keyframe holds.",
        "smooth",
    ),
}

FOLD_KEYS = {
    "time": Key(Number(-1e4, 1e5, "s"), "Time since the first frame."),
    "fold": Key(Number(0, 1), "0 spread, 1 folded."),
}


_ANGLE = Number(-180, 180, "deg")
_SERIES_KEYS = {
    "mean": Key(_ANGLE, "Mean over the beat.", 0.0),
    "harmonics": Key(
        ArrayOf(ArrayOf(_ANGLE, 2, 2), 0, 16),
        "[cos, sin]: amplitudes of the first, second, ... harmonic of the phase. Default: none; of "
        "`elevation` one cosine.",
        (),
    ),
}


def _curve(meaning: str, default: Any = 0.0) -> Key:
    """A joint's angle over the phase of a beat."""
    keys = ArrayOf(ArrayOf(Number(-180, 180), 2, 2), 2, 100)
    series = Table(_SERIES_KEYS, "table of a Fourier series")
    note = (
        "A number, a Fourier series, or [phase, degrees] from phase 0 (top) over 0.5 (bottom) on."
    )
    types = Either({int: _ANGLE, float: _ANGLE, dict: series, list: keys})
    return Key(types, f"{meaning} {note}", default)


def _changing(number: Number, meaning: str, default: Any = REQUIRED) -> Key:
    """A number, or what it is over time."""
    pairs = ArrayOf(ArrayOf(Number(-1e5, 1e5), 2, 2), 1, 1000)
    types = Either({int: number, float: number, list: pairs})
    return Key(types, f"{meaning} A number, or [time, value] pairs: smooth between.", default)


# within less than a period roots are faster at first than later, and feathers are thrown
_RAMP_PERIODS = Key(
    Number(0.01, 1000), "Periods within which it rises from rest to its amplitude.", 1.0
)

_AXES = tuple(f"{what}_{axis}" for what in ("position", "rotation") for axis in "xyz")
_MOTION: dict[str, Key] = {}
_KINDS: dict[str, dict[str, Key]] = {}
_PRESET = Preset("motion", _MOTION, _KINDS)  # its keys follow: a motion may be made of motions

MOTION_KEYS: dict[str, dict[str, Key]] = {
    "hold": {},
    "shake": {
        "amplitude": Key(Number(0, 100, "m"), "Amplitude of the shake."),
        "frequency": Key(Number(0.001, 1000, "Hz"), "Shakes per second."),
        "direction": Key(Direction(), "Direction of the shake."),
        "ramp_periods": _RAMP_PERIODS,
    },
    "flap": {
        "wingbeat_frequency": _changing(Number(0.001, 1000, "Hz"), "Beats per second."),
        "beats": Key(
            Number(0, 1e6),
            "Beats from rest to rest, the first two faster and faster, the last two slower and "
            "slower. 0: it beats before its start and on and on; `amount` lets it begin and end.",
            0.0,
        ),
        "stroke_amplitude": _changing(
            Number(0, 180, "deg"),
            "Angle between top and bottom of the stroke, to which `elevation` is scaled.",
        ),
        "downstroke": _changing(
            Number(0.1, 0.9), "Share of a beat's time in which the wing falls.", 0.5
        ),
        "stroke_plane": _changing(
            _ANGLE,
            "Lean of the plane of the stroke: 0 straight up and down the body, 90 forwards and "
            "backwards along it, as with a trunk that rises by 21 degrees (`trunk_angle`).",
            0.0,
        ),
        "span_ratio": _changing(
            Number(0.05, 1),
            "Reach of a wing, from the line through its shoulder along the body to its tip, in the "
            "middle of the upstroke over that of the downstroke; `elbow` and `wrist` are scaled "
            "to it. Default: as they are.",
            None,
        ),
        "tip_reversal": _changing(
            _ANGLE, "Turn of the hand about its length in the middle of the upstroke.", 0.0
        ),
        "turn": _changing(
            _ANGLE,
            "For a turn to the left, by how much the left wing is swept back and its leading edge "
            "lowered, and the right one swept forwards and raised.",
            0.0,
        ),
        "heave": _changing(
            Number(0, 2),
            "Share of the body's heave under the lift of the downstrokes, which bears its weight.",
            0.0,
        ),
        "pitch": _changing(
            _ANGLE, "Pitch of the body under the same lift, from lowest to highest: nose up.", 0.0
        ),
        "elevation": _curve(
            "Stroke of the arm over the beat, positive upwards.",
            {"mean": 0.0, "harmonics": [[1.0, 0.0]]},
        ),
        "sweep": _curve("Turn of the arm backwards, beside its plane."),
        "twist": _curve("Turn of the wing about its span, positive: leading edge down."),
        "elbow": _curve("Folding of the elbow."),
        "wrist": _curve("Folding of the wrist, and with it of the hand's fan."),
    },
    "fold": {
        "folds": Key(
            ArrayOf(Table(FOLD_KEYS, "table of a fold"), 1, 100_000),
            "Folds in the order of their times; between two, and at rest in each, smoothly.",
        ),
        "joints": Key(
            Text(), "Joints of wings, tails and crests that fold, with * and ? as wild cards.", "*"
        ),
    },
    "keys": {
        "keyframes": Key(
            ArrayOf(Table(KEYFRAME_KEYS, "table of a keyframe"), 1, 100_000),
            "Keyframes; curves between them stay within the range of the two.",
        ),
        "extrapolation": Key(
            Text(("hold", "linear")),
            "Beyond the first and last keyframe: hold, they hold; linear, curves go on.",
            "hold",
        ),
    },
    "curve": {
        "usd": Key(Text(), "USD file, as seen from the shot file's folder."),
        "prim": Key(Text(), "Path of the prim with the attribute."),
        "attribute": Key(
            Text(),
            "Attribute of 1 number, 3, or a quaternion, as time samples or a spline. The shot's "
            "first frame is the time code of its number.",
        ),
        "sets": Key(
            Text(("position", "rotation", *_AXES)),
            "What it sets, about and along the stage's axes: 3 numbers or a quaternion, or of 1 "
            "number an axis; in the stage's unit, or degrees.",
        ),
        "joint": KEYFRAME_KEYS["joint"],
        "order": KEYFRAME_KEYS["order"],
        "time": Key(
            Text(("codes", "seconds")),
            "What a frame is where the stage's time codes per second are not frames_per_second: "
            "codes, frame N is time code N; seconds, as USD composes layers of other rates.",
            None,
        ),
    },
    "swing": {
        "joints": Key(
            Text(empty=True),
            "Joints that swing, with * and ? as wild cards; empty: the whole groom.",
            "",
        ),
        "axis": Key(Direction(), "Axis through the joint, in the groom's axes."),
        "angle": Key(Number(0, 180, "deg"), "Amplitude."),
        "frequency": Key(Number(0.001, 1000, "Hz"), "Swings per second."),
        "phase": Key(Number(-1, 1), "Share of a swing by which it comes later.", 0.0),
        "ramp_periods": _RAMP_PERIODS,
    },
    "level": {
        "trunk_angle": Key(
            Number(-90, 90, "deg"),
            "Most that the trunk rises from the root of the tail to the middle between the "
            "shoulders: the groom pitches down to it, about that middle. `right_tarsus` and "
            "`left_tarsus` keep their direction.",
        ),
        "neck_angle": Key(
            Number(-90, 180, "deg"),
            "Most that a long neck rises then, from its root to the head, which keeps its "
            "direction. Short ones bend less.",
            180.0,
        ),
    },
    "act": {
        "motions": Key(
            ArrayOf(PartPreset(_PRESET), 1, 100),
            "Motions one upon the other: each moves the groom as those before it have left it. "
            "Those whose joints the groom lacks are left out, as long as one is left.",
        ),
        "body": Key(
            Text(("skin", "act")),
            "What moves the body beside a [skin]: skin, its own motion; act, turns and ways of the "
            "whole groom, which carry the skin as it is at the first frame.",
            "skin",
        ),
        "joints": Key(
            TextsByName(),
            "Joints of the skin's skeleton that joints of the groom drive, by the names of these: "
            "paths, or their ends. They stand as the act has the groom's, since the skin's rest. "
            "neck, head, right_leg, right_tarsus, right_foot and the left ones need none in the "
            "groom.",
            {},
        ),
        "steady_head": Key(
            Number(0, 1),
            "Share of the body's pitch, roll and heave that neck and head take back, where `joints`"
            " names them.",
            0.0,
        ),
        "planted_feet": _changing(
            Number(0, 1),
            "Share by which feet stand where they are at rest, as far as legs reach that are bent"
            " at rest, where `joints` names leg, tarsus and foot.",
            0.0,
        ),
    },
}

MOTION_KIND_KEY = Key(
    Text(tuple(MOTION_KEYS)), "Kind of motion; it decides which of the keys below apply."
)
SOURCE_KEYS = {
    "cites": Key(
        ArrayOf(Text(), 0, 20), "Publications that figures of the motion come from, and which.", ()
    ),
    "by_eye": Key(Flag(), "Whether what no publication is cited for is set by eye.", False),
}
_KINDS |= {
    kind: {"kind": MOTION_KIND_KEY} | keys | keys_of(Clock) | SOURCE_KEYS
    for kind, keys in MOTION_KEYS.items()
}
_MOTION |= {name: key for keys in _KINDS.values() for name, key in keys.items()}
# patterns of a fold or a swing, and the map of an act
_MOTION["joints"] = Key(Either({str: Text(empty=True), dict: TextsByName()}), "Joints.", None)

PRESET_FAMILIES = {
    each.family: each
    for each in (
        Preset("feather", FEATHER_KEYS),
        Preset("material/vane", keys_of(VaneMaterial)),
        Preset("material/rachis", keys_of(RachisMaterial)),
        Preset("quality", keys_of(Quality)),
        Preset("wind", keys_of(Wind)),
        _PRESET,
        Preset("wing", LazyKeys("featherfx.groom.keys.anatomy", "WING_TYPE")),
        Preset("bird", LazyKeys("featherfx.groom.keys.anatomy", "BIRD_TYPE")),
    )
}
