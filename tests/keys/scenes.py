"""Small scenes that use every key of grooms, shots and presets, and values that a key may have."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, NamedTuple


class Scene(NamedTuple):
    """Tables of a groom and a shot.

    tries: beginnings of the paths of keys that it tries. values: other values by the end of a path,
    where none can be told from a type. options: of the bake.
    """

    groom: dict[str, Any]
    shot: dict[str, Any]
    tries: tuple[str, ...]
    values: Mapping[str, list[Any]] = MappingProxyType({})
    leaves: tuple[str, ...] = ()
    options: Mapping[str, Any] = MappingProxyType({})


# without an error to keep, so that rows are simulated as they are given; presets have one
ROWS = {"rows": 9, "columns": 4, "coefficients": 1, "tolerance": 1e-3, "spectral_radius": 0.5}
QUALITY = ROWS | {"rows": 7, "columns": 3}
PROMISE = {"base": "draft", "rows": 7, "columns": 3}
SHAKE = {"kind": "shake", "amplitude": 0.02, "frequency": 4, "direction": [0, 0.3, 1]}
OUTLINE = [[0, 0], [0.1, 0.02], [0.6, 0.03], [1, 0.02]]
FEATHER = {
    "id": "feather",
    "kind": "swan_primary",
    "position": [0, 0, 0],
    "direction": [1, 0, 0],
    "up": [0, 0, 1],
}


def shot(**tables):
    """A shot of two frames, whose roots shake unless it has a skin."""
    motion = {} if "skin" in tables else {"motion": SHAKE}
    usual = {"name": "shot", "groom": "groom.toml", "frames": [1, 2], "quality": QUALITY}
    return usual | motion | tables


def groom(**tables):
    """A groom of one feather, unless it has others."""
    return {"name": "groom", "feather": [FEATHER]} | tables


def vane(**more):
    """A vane with every table that it may have."""
    return {
        "outline": OUTLINE,
        "guides": [
            {"position": 0.0, "angle": 45, "curl": 3, "camber": 4},
            {"position": 1.0, "angle": 25, "course": [[0, 0, 0], [0.5, 10, 5], [1, 0, 0]]},
        ],
        "hooked": {"rachis": [[0, 1], [1, 0.5]], "barb": [[0, 1], [1, 0.5]]},
    } | more


PROFILE = {"rachis": [[0, 1], [1, 0.5]], "barb": [[0, 1], [1, 0.5]]}
VANE_MATERIAL = {
    "base": "swan_vane",
    "thickness_profile": PROFILE,
    "across_barbs_profile": PROFILE,
    "along_barbs_profile": PROFILE,
}
RACHIS_MATERIAL = {"base": "keratin_rachis", "modulus_profile": [[0, 1], [1, 0.5]]}
RACHIS = {
    "diameter_base": 0.004,
    "diameter_tip": 0.0005,
    "course": [[0, 0, 0, 0], [0.5, 10, 5, 5], [1, 0, 0, 0]],
    "diameter_profile": [[0, 1], [1, 0.8]],
}
BARS = {"kind": "bars", "colour": [0.1, 0.1, 0.1], "film": 2e-7, "size": 0.4}
COLOUR = {
    "base": [0.6, 0.4, 0.3],
    "rachis": [0.2, 0.2, 0.2],
    "patterns": [BARS],
    "brightness_variation": 0.2,
}
BARBS = {"clump": 0.5, "clump_count": 3, "frizz": 0.002, "jitter": 0.3, "loose": 0.3}
SHAPE = {
    "rachis": RACHIS,
    "leading": vane(),
    "trailing": vane(),
    "vane_material": VANE_MATERIAL,
    "rachis_material": RACHIS_MATERIAL,
    "colour": COLOUR,
    "barbs": BARBS,
}
SPLITS = {"places": [[0.5, 0.5]], "count": 2}
PULL = {
    "feather": "feather",
    "row": 0.9,
    "column": 0.3,
    "displacement": [0.0, 0.01, 0.01],
    "end": 0.02,
    "stiffness": 100,
}

SECOND = {"id": "second", "position": [0, 0.004, 0.003], "region": "wing", "kind": "swan_secondary"}
PAIR = [FEATHER, FEATHER | SECOND]
# patterns that fit one of both
SOME = {
    ".feathers": ["second"],
    ".region": ["wing"],
    ".kind": ["swan_secondary"],
    ".exclude": [["second"]],
}
ROOT = {"position": [0, 0, 0], "direction": [1, 0, 0], "up": [0, 0, 1]}
ROW = {
    "id": "row",
    "kind": ["covert", "contour"],
    "count": 3,
    "first": ROOT,
    "last": ROOT | {"position": [0, 0.06, 0], "direction": [1, 0.3, 0.1], "up": [0, 0.2, 1]},
}
# what is placed is seen without simulation
RIGID = {"detail": [{"level": "rigid"}]}
HOLD = {"motion": "hold"}
# keys of motions that say where their figures come from
SOURCES = (".cites", ".by_eye")
EDGE = {"usd": "scene.usda", "prim": "/edge"}
FLIGHT = {"count": 2, "lengths": [0.08, 0.1], "kind": "covert"}
COVERT = {"name": "greater_covert", "kind": "covert", "length": 0.4, "gap": 0.004}
WING_TYPE = {
    "base": "pigeon",
    "primaries": FLIGHT,
    "secondaries": FLIGHT,
    "tertials": FLIGHT,
    "alula": FLIGHT,
    "coverts": [
        COVERT | {"chord_position": 0.2, "hand": 0.6},
        COVERT | {"name": "under_covert", "chord_position": 0.3, "side": "below"},
    ],
}
WING = {"id": "right_wing", "type": WING_TYPE, "shoulder": [0, 0, 0], "fold": 0.4}
TAIL = {
    "id": "tail",
    "position": [0, 0, 0],
    "kind": "covert",
    "count": 2,
    "lengths": [0.1, 0.08],
    "root_width": 0.02,
    "fan": 0.4,
    "coverts": [{"name": "upper", "length": 0.5, "ahead": 0.02, "height": 0.02, "kind": "contour"}],
}
CREST = {
    "id": "crest",
    "path": [[0, 0, 0], [-0.02, 0, 0.01]],
    "kind": "covert",
    "count": 2,
    "lengths": [0.03, 0.02],
    "raise": 0.4,
}
BODY = {"name": "body", "position": [0.05, 0, 0.05]}
JOINTS = [
    {"name": "right_shoulder", "position": [0, -0.02, 0], "role": "shoulder", "side": "right"},
    {
        "name": "right_elbow",
        "position": [0, -0.05, 0],
        "parent": "right_shoulder",
        "role": "elbow",
        "side": "right",
    },
    {
        "name": "right_wrist",
        "position": [0, -0.08, 0],
        "parent": "right_elbow",
        "role": "wrist",
        "side": "right",
    },
]
WINGED = groom(joint=JOINTS, feather=[FEATHER | {"joint": "right_wrist"}])
CLOCK = {"amount": [[0.0, 0.5], [1.0, 1.0]]}
SKIN = {"usd": "scene.usda", "prim": "/skin"}
WHERE = {"x": [-0.06, 0.1], "soft": 0.02}
REGION = {
    "id": "coat",
    "kind": [{"name": "contour", "share": 2.0}, "covert"],
    "count": 6,
    "flow": {"direction": [1, 0, 0]},
    "length": 0.02,
    "variation": {"length": 0.1},
}
SKINNED = {"skin": {"usd": "scene.usda", "prim": "/skin"}}
GROWN = SKINNED | RIGID

# keys of a feather's preset, which the scene "feather" tries
FEATHER_KEYS = tuple(
    f".overrides.{name}"
    for name in (
        *("length", "calamus", "barb_spacing", "vane_material", "rachis_material", "rachis"),
        *("leading", "trailing", "colour", "barbs", "stiffness", "weight"),
    )
)

LOSS = {"loss_band": [1, 200], "reference_frequency": 20}
SCENES = {
    "drawn pose": Scene(
        groom(drawn_pose="equilibrium", gravity=[0, 0, -9.81]),
        shot(),
        ("groom.drawn_pose", "groom.gravity"),
    ),
    "feather": Scene(
        groom(feather=[FEATHER | {"overrides": SHAPE}]),
        shot(grip=[PULL | {"column": 1.0, "displacement": [0, 0.02, 0.02]}]),
        ("groom.feather.0.overrides",),
        {
            ".line": [[[0, 0], [0.5, 0.1], [1, 0]], [[0, 0, 0], [0.5, 0.1, 0], [1, 0, 0]]],
            "vane_material.base": ["plume_vane"],
            "rachis_material.base": ["measured_rachis"],
            ".film": [3e-7, 5e-7],
            ".course": [
                [[0, 0, 0], [0.5, 30, 9], [1, 0, 0]],
                [[0, 0, 0, 0], [0.5, 40, 5, 5], [1, 0, 0, 0]],
            ],
        },
        (
            ".scaling",
            ".modulus_along_barbs",
            ".ribbon",
            ".poissons_ratio",
            ".hook_yield_across",
            ".hook_yield_shear",
            ".hook_strength",
            ".hook_slip",
            ".hook_release",
            ".hook_healing_rate",
            ".hook_scatter",
            ".guides.0.line",
            ".guides.1.line",
            ".splits",
            ".barb_spacing",
            ".barb_spacing_exponent",
            ".thickness_exponent",
            ".overrides.barbs",
            ".loss_band",
            ".reference_frequency",
        ),
    ),
    "loss band": Scene(
        groom(
            feather=[
                FEATHER
                | {"scale": 1.2, "overrides": {"vane_material": LOSS, "rachis_material": LOSS}}
            ]
        ),
        shot(grip=[PULL]),
        (
            "groom.feather.0.overrides.thickness_exponent",
            *(
                f"groom.feather.0.overrides.{part}_material.{key}"
                for part in ("vane", "rachis")
                for key in ("loss_band", "reference_frequency")
            ),
        ),
    ),
    "barbs": Scene(
        groom(feather=[FEATHER | {"scale": 1.2, "overrides": {"barbs": BARBS}}]),
        shot(),
        ("groom.feather.0.overrides.barbs", "groom.feather.0.overrides.barb_spacing"),
        options={"barbs": 6},
    ),
    "placing": Scene(
        groom(
            feather=[FEATHER | {"id": "right", "scale": 1.2, "overrides": {"scaling": "similar"}}]
        ),
        shot(),
        ("groom.feather.0",),
        {
            ".id": ["right_other"],
            "feather.0.kind": ["swan_secondary"],
            ".region": ["wing"],
            ".up": [[0, 0.5, 1]],
            ".mirror": ["y"],
        },
        (".rotation", ".joint", ".thickness_exponent", *FEATHER_KEYS),
    ),
    "turned": Scene(
        groom(
            feather=[
                {"id": "feather", "kind": "swan_primary", "position": [0, 0, 0]}
                | {"rotation": [0, 0, 0]}
            ]
        ),
        shot(),
        ("groom.feather.0.rotation",),
        {".rotation": [[10, 20, 30]]},
    ),
    "barbs by lines": Scene(
        groom(
            feather=[
                FEATHER
                | {
                    "overrides": {
                        "leading": {
                            "guides": [{"position": 0, "line": [[0, 0], [0.5, 0.4], [1, 1]]}]
                        }
                    }
                }
            ]
        ),
        shot(),
        ("groom.feather.0.overrides.leading.guides.0.line",),
        {".line": [[[0, 0], [0.5, 0.6], [1, 1]]]},
    ),
    "splits": Scene(
        groom(feather=[FEATHER | {"overrides": {"leading": {"splits": SPLITS}}}]),
        shot(),
        ("groom.feather.0.overrides.leading.splits",),
        {".places": [[[0.3, 0.5]]], ".where": [[0.3, 0.5]]},
    ),
    "hooks": Scene(
        groom(
            feather=PAIR,
            overrides={
                "*": {
                    "vane_material": {
                        "base": "swan_vane",
                        "hooks": "open",
                        "hook_yield_across": 20.0,
                        "hook_yield_shear": 20.0,
                        "hook_strength": 60.0,
                        "hook_healing_rate": 5.0,
                    }
                }
            },
        ),
        shot(
            frames=[1, 3],
            motion="hold",
            grip=[PULL | {"column": 1.0, "row": 0.5, "displacement": [0.02, 0.02, 0.0]}],
            preen=[{"start": 0.03, "end": 0.08, "max_gap": 0.05}],
        ),
        ("groom.overrides.*.vane_material.hook", "shot.preen"),
        SOME,
    ),
    "ribbon": Scene(
        groom(
            feather=[
                FEATHER | {"overrides": {"vane_material": {"base": "swan_vane", "ribbon": True}}}
            ]
        ),
        shot(grip=[PULL]),
        (
            "groom.feather.0.overrides.vane_material.poissons_ratio",
            "groom.feather.0.overrides.vane_material.ribbon",
        ),
    ),
    "overrides": Scene(
        {
            "name": "groom",
            "row": [ROW | {"kind": "covert"}],
            "overrides": {"*": {"scale": 1.1}},
            "variation": {"seed": 2, "length": 0.1, "roll": 5.0, "camber": 5.0},
        },
        shot(),
        (
            "groom.overrides.*.scale",
            "groom.overrides.*.width",
            "groom.overrides.*.roll",
            "groom.variation",
        ),
    ),
    "row": Scene(
        {"name": "groom", "row": [ROW]},
        shot(**HOLD),
        ("groom.row",),
        {
            ".id": ["other"],
            "row.0.kind": ["covert"],
            ".up": [[0, 0.5, 1]],
            ".path": [[[0, 0, 0], [0.02, 0.03, 0], [0, 0.06, 0]]],
            ".curve": [EDGE],
            ".region": ["wing"],
            ".overrides": [{"length": 0.05}],
        },
        (".turn_with_path", ".joint", ".mirror"),
    ),
    "row on a curve": Scene(
        {"name": "groom", "row": [ROW | {"curve": EDGE}]},
        shot(**HOLD),
        ("groom.row.0.curve", "groom.row.0.turn_with_path"),
        {".prim": ["/other_edge"]},
        (".usd", ".joints", ".tail"),
    ),
    "wing": Scene(
        {"name": "groom", "wing": [WING], "joint": [BODY]},
        shot(motion={"base": "fold"}, **RIGID),
        ("groom.wing",),
        {
            ".base": ["swan"],
            ".id": ["left_wing"],
            ".kind": ["contour"],
            ".name": ["other"],
            ".elbow": [[100, 60]],
            ".wrist": [[130, 60]],
            ".forward": [[1, 0.4, 0]],
            ".up": [[0, 0.3, 1]],
            ".lengths": [[0.1, 0.12]],
        },
        (
            ".joint",
            ".loose",
            ".body_clearance",
            "wing.0.elbow",
            "wing.0.wrist",
            "wing.0.tip",
            ".skeleton",
        ),
    ),
    "wing by landmarks": Scene(
        {
            "name": "groom",
            "wing": [
                {"id": "right_wing", "type": WING_TYPE, "shoulder": [0, 0, 0]}
                | {"elbow": [-0.02, -0.04, 0], "wrist": [0.01, -0.08, 0], "tip": [0, -0.13, 0]}
            ],
        },
        shot(**HOLD),
        ("groom.wing.0.elbow", "groom.wing.0.wrist", "groom.wing.0.tip"),
    ),
    "tail": Scene(
        {"name": "groom", "tail": [TAIL], "joint": [BODY]},
        shot(motion={"base": "fold"}, **RIGID),
        ("groom.tail",),
        {
            ".id": ["other"],
            ".kind": ["down"],
            ".name": ["other"],
            ".region": ["end"],
            ".direction": [[-1, 0, 0.3]],
            ".up": [[0, 0.3, 1]],
            ".count": [4],
        },
        (".joint",),
    ),
    "crest": Scene(
        {"name": "groom", "crest": [CREST], "joint": [BODY]},
        shot(motion={"base": "fold"}, **RIGID),
        ("groom.crest",),
        {
            ".id": ["other"],
            ".kind": ["contour"],
            ".region": ["head"],
            ".path": [[[0, 0, 0], [-0.04, 0, 0.02]]],
            ".direction": [[-1, 0, 0.3]],
            ".up": [[0, 0.3, 1]],
        },
        (".joint",),
    ),
    "joints": Scene(
        WINGED,
        shot(
            motion={
                "kind": "flap",
                "wingbeat_frequency": 5,
                "beats": 0.3,
                "stroke_amplitude": 60,
                "elbow": {"mean": 5, "harmonics": [[10, 0]]},
                "wrist": {"mean": 5, "harmonics": [[10, 0]]},
            },
            frames=[1, 4],
        ),
        ("groom.joint", "groom.feather.0.joint", "shot.motion"),
        {
            "feather.0.joint": ["right_elbow"],
            "joint.2.parent": [""],
            ".role": ["shoulder", "elbow"],
            "motion.kind": ["shake"],
        },
        (
            ".name",
            ".mirror",
            ".base",
            ".kind",
            ".size",
            ".fit",
            ".amount",
            *(".span_ratio", ".tip_reversal", ".elevation", *SOURCES),
            "joint.0.parent",
            "joint.1.parent",
            "joint.0.role",
            "joint.1.role",
            "joint.2.side",
            "joint.1.side",
            "joint.0.position",
        ),
    ),
    "wing beat": Scene(
        WINGED,
        shot(
            motion={
                "kind": "flap",
                "wingbeat_frequency": 3.0,
                "beats": 0,
                "start": -1,
                "stroke_amplitude": 60.0,
                "downstroke": 0.6,
                "stroke_plane": 20.0,
                "tip_reversal": 30.0,
                "turn": 5.0,
                "elevation": {"mean": 5, "harmonics": [[1, 0]]},
                "sweep": [[0, 0], [0.5, 8], [0.7, 12]],
                "twist": {"harmonics": [[0, 10]]},
                "elbow": {"mean": 5, "harmonics": [[0, -8]]},
                "wrist": {"mean": 5, "harmonics": [[0, -8]]},
            },
            frames=[1, 3],
        ),
        ("shot.motion",),
        {
            ".wingbeat_frequency": [2.0],
            ".downstroke": [0.4],
            **{f".{name}": [40.0] for name in ("stroke_amplitude", "stroke_plane", "turn")},
            **{f".{name}": [5.0] for name in ("sweep", "twist", "elbow", "wrist")},
        },
        (".kind", ".base", ".fit", ".amount", ".size", ".tempo", ".start", ".span_ratio", *SOURCES),
    ),
    "flap with a clock": Scene(
        WINGED,
        shot(motion={"base": "flap", **CLOCK}, frames=[1, 4]),
        ("shot.motion.start", "shot.motion.tempo", "shot.motion.amount"),
        {".amount": [[[0.0, 0.1], [1.0, 0.2]]]},
    ),
    "shake": Scene(
        groom(),
        shot(motion=SHAKE),
        ("shot.motion", "shot.gravity", "shot.settle", "shot.frames"),
        {"shot.frames": [[1, 3]]},
        (".base", ".kind", ".fit", ".amount", ".frames_per_second", *SOURCES),
    ),
    "keyframes": Scene(
        WINGED,
        shot(
            motion={
                "kind": "keys",
                "keyframes": [
                    {"time": 0.0, "joint": "right_wrist", "rotation": [20, 10, 10]},
                    {"time": 0.0, "joint": "right_wrist", "position": [0, 0, 0]},
                    {"time": 0.1, "joint": "right_wrist", "position": [0, 0, 0.01]},
                ],
            }
        ),
        ("shot.motion.keyframes", "shot.motion.extrapolation"),
        {"1.time": [0.05], ".joint": [""], ".tangents": ["linear"], ".order": ["zyx"]},
        # a curve of one key, and positions, which have no order of axes
        ("0.time", "0.tangents", "0.position", "1.rotation", "1.order", "2.order"),
    ),
    "fold": Scene(
        {"name": "groom", "tail": [TAIL]},
        shot(
            motion={
                "kind": "fold",
                "folds": [{"time": 0.0, "fold": 0.0}, {"time": 0.1, "fold": 1.0}],
            }
        ),
        ("shot.motion.folds", "shot.motion.joints"),
        {".fold": [0.3, 0.6], "folds.0.time": [-0.1]},
        (".joints",),
    ),
    "swing": Scene(
        WINGED,
        shot(
            motion={
                "kind": "swing",
                "joints": "right_wrist",
                "axis": [0, 0, 1],
                "angle": 20,
                "frequency": 4,
            }
        ),
        ("shot.motion",),
        {".joints": ["", "right_shoulder"]},
        (".base", ".kind", ".size", ".fit", ".amount", *SOURCES),
    ),
    "level": Scene(
        groom(
            wing=[WING | {"shoulder": [0.05, -0.02, 0.05]}],
            tail=[TAIL],
            joint=[
                {"name": "neck", "position": [0.05, 0, 0.05]},
                {"name": "head", "position": [0.09, 0, 0.1], "parent": "neck"},
            ],
            feather=[FEATHER | {"joint": "neck"}],
        ),
        shot(motion={"kind": "level", "trunk_angle": 10, "neck_angle": 20}, **RIGID),
        ("shot.motion.trunk_angle", "shot.motion.neck_angle"),
    ),
    "act": Scene(
        groom(),
        shot(motion={"kind": "act", "motions": [SHAKE]}),
        ("shot.motion.motions.0.amplitude",),
    ),
    "wind": Scene(
        groom(feather=PAIR),
        shot(
            wind={"base": "breeze", "direction": [0, 1, 0.5], "speed": 8, "gust": 0.5},
            wet=[{"keys": [[0.0, 0.5]]}],
            shelter=[{"share": 0.4}],  # not that of two vanes, 0.3
        ),
        ("shot.wind", "shot.wet", "shot.shelter"),
        {"wind.base": ["storm"], **SOME, ".keys": [[[0.0, 0.2]]]},
        ("shot.wind_usd", ".hooks"),
        {"barbs": 6},
    ),
    "forces": Scene(
        groom(feather=PAIR),
        shot(
            motion="hold",
            grip=[PULL | {"end": 0.06}],
            force=[
                {
                    "feather": "feather",
                    "force": [0, 0.01, 0.02],
                    "row": 0.7,
                    "column": 0.5,
                    "keys": [[0, 1], [0.03, 0.5]],
                }
            ],
        ),
        ("shot.grip", "shot.force"),
        {
            ".feather": ["second"],
            ".keys": [[[0, 0.4]]],
            "grip.0.start": [0.01],
            ".max_force": [1e-3],
        },
        (".span",),
    ),
    "force on a line": Scene(
        groom(),
        shot(motion="hold", force=[{"feather": "feather", "force": [0, 0, 0.1], "line": "rachis"}]),
        ("shot.force.0.span",),
        {".span": [[0.2, 0.5]]},
    ),
    "quality": Scene(
        groom(),
        shot(motion=SHAKE | {"amplitude": 0.1, "frequency": 12}, quality=PROMISE),
        ("shot.quality", "shot.frames_per_second"),
        {"quality.base": ["plumage"]},
        (
            ".tolerance",
            ".relative_tolerance",
            ".contact_tolerance",
            ".max_substeps",
            ".coarse_below",
            ".guided_below",
            ".guided_every",
            ".body_size",
        ),
    ),
    "quality by tolerance": Scene(
        groom(),
        shot(motion=SHAKE | {"amplitude": 0.1, "frequency": 12}, quality=QUALITY),
        ("shot.quality.tolerance", "shot.quality.relative_tolerance"),
        {".relative_tolerance": [1e-5]},
    ),
    "contact": Scene(
        groom(feather=PAIR),
        shot(motion={**SHAKE, "amplitude": 0.05}, contact={"thickness": 0.002}),
        ("shot.contact",),
        {".layered": [["wing"]], ".regions": [["wing"]], ".kinds": [["swan_secondary"]]},
        (".skin", ".obstacles", ".ease", ".max_steps"),
    ),
    "detail": Scene(
        groom(feather=PAIR),
        shot(detail=[{"level": "rigid"}]),
        ("shot.detail",),
        SOME,
        (".every", ".spacing"),
    ),
    "collider": Scene(
        groom(),
        shot(
            motion="hold", contact={}, collider=[{"usd": "scene.usda", "prims": ["/other_plate"]}]
        ),
        ("shot.collider.0.prims", "shot.collider.0.collection", "shot.collider.0.start"),
        {".prims": [["/plate"]], ".collection": ["/plate.collection:hit"], ".start": [2]},
    ),
    "channels": Scene(
        groom(feather=PAIR),
        shot(
            channel=[{"name": "ruffle", "keys": [[1, 10], [2, 30]]}],
            target=[{"keys": [[1, 0.5], [3, 1.0]]}],
            **SKINNED,
        ),
        ("shot.channel", "shot.target"),
        {
            **SOME,
            "channel.0.keys": [[[1, 5], [2, 10]]],
            "target.0.keys": [[[1, 1.0]]],
            ".map": ["mask"],
        },
        (".soft", ".shape", "target.0.frame"),
    ),
    "detach": Scene(
        groom(feather=PAIR),
        shot(frames=[1, 4], detach=[{"frame": 2}]),
        ("shot.detach",),
        SOME | {".frame": [3]},
    ),
    "skin": Scene(
        groom(),
        shot(**SKINNED, frames=[1, 3]),
        ("shot.skin",),
        {".prim": ["/patch"], ".rest": [2], ".smoothing_radius": [0.08]},
        (
            *(".usd", ".start", ".tolerance", ".extrapolation", ".time", ".on_collapse"),
            *(".variant_sets", ".subdivision", ".uv", ".wrap"),
        ),
    ),
    "wind of a scene": Scene(
        groom(),
        shot(motion="hold", frames=[1, 3], wind_usd={"usd": "scene.usda", "prim": "/air"}),
        ("shot.wind_usd",),
        {".attribute": ["gale"], ".start": [2], ".scale": [3.0]},
        (".usd", ".prim", ".time"),
    ),
    "table": Scene(
        {"name": "groom", "table": {"file": "table.csv"}},
        shot(**HOLD),
        ("groom.table",),
        {".file": ["other.csv"], ".region": ["wing"]},
        (".kind", ".joint", ".mirror"),
    ),
    "table without kinds": Scene(
        {"name": "groom", "table": {"file": "no_kind.csv", "kind": "covert"}},
        shot(**HOLD),
        ("groom.table.kind",),
        {".kind": ["contour"]},
    ),
    "drawn": Scene(
        {"name": "groom", "usd": {"file": "scene.usda", "prims": ["/drawn"], "names": {}}},
        shot(**HOLD),
        ("groom.usd",),
        {
            ".prims": [["/more"]],
            ".file": [],
            "usd.kind": ["contour"],
            ".region": ["wing"],
            ".time": [3],
            "usd.up": [[0, 1, 1]],
            "names.kind": ["sort"],
            "names.up": ["above"],
            "names.scale": ["larger"],
            "names.region": ["label"],
            "names.id": ["label"],
        },
        (
            "usd.file",
            "usd.kind",
            "usd.up",
            ".frame",
            "names.region",
            ".skin",
            ".skin_uv",
            ".left_barbs",
            ".right_barbs",
            ".joint",
            ".variant_sets",
            ".purposes",
            ".invisible",
        ),
    ),
    "region": Scene(
        {"name": "groom", "skin": SKIN, "region": [REGION | {"where": [WHERE]}]},
        shot(**SKINNED),
        ("groom.region", "groom.skin"),
        {
            ".id": ["other"],
            ".name": ["down"],
            "region.0.kind": ["covert"],
            ".prim": ["/patch"],
            ".usd": [],
            ".primvar": ["mask"],
            "flow.primvar": ["flow"],
            ".subset": ["half"],
            ".box": [[[-0.1, -0.1, -1], [0.02, 0.1, 1]]],
            ".sphere": [[0.05, 0, 0, 0.05]],
            ".nearest": [{"to": [[0.1, 0, 0]], "than": [[-0.1, 0, 0]]}],
            ".facing": [[1, 0, 1]],
            ".free_radius": [0.5],
            ".x": [[0.0, 0.1]],
            ".y": [[0.0, 0.1]],
            ".z": [[0.001, 0.1]],
            ".where": [[WHERE]],
            ".away": [[0.3, 0.5, 0]],
            ".towards": [[0.3, 0.5, 0]],
            ".curves": [["/edge"]],
            ".density": [300.0],
            ".overrides": [{"calamus": 0.3}],
            ".rest": [2],
            ".colours": ["displayColor"],
            ".max_feathers": [2],
        },
        (
            *("skin.usd", ".max_feathers", "kind.0.where", ".primvar", ".subset", ".image", ".box"),
            *(".sphere", ".y", ".z", ".nearest", ".facing", ".free_radius", ".angle"),
            *(".soft_angle", ".density", ".away", ".towards", ".curves", ".blend"),
            *(".max_length_per_free_radius", "region.0.joint", "region.0.variants"),
            *(".variant_sets", ".subdivision", ".uv", ".wrap", ".ids_from"),
        ),
    ),
    "layout": Scene(
        {
            "name": "groom",
            "skin": SKIN,
            "region": [REGION | {"count": 12}],
            "layout": {"thickness": 0.1},
        },
        shot(**GROWN),
        ("groom.layout",),
    ),
    "levels": Scene(
        groom(),
        shot(quality=ROWS, level_of_detail={"pixels_per_metre": 1000.0, "coarse_below": 100.0}),
        ("shot.level_of_detail",),
        {
            ".enabled": [],
            ".pixels_per_metre": [10.0],
            ".coarse_below": [2000.0],
            ".rachis_below": [2000.0],
            ".rigid_below": [2000.0],
        },
        (
            *(".enabled", ".usd", ".prim", ".image_height", ".guided_below", ".outside"),
            *(".margin", ".motion", ".start", ".time"),
        ),
    ),
    "levels by camera": Scene(
        groom(feather=[FEATHER, FEATHER | {"id": "aside", "position": [0, 1.5, 0]}]),
        shot(
            level_of_detail={
                "usd": "scene.usda",
                "prim": "/camera",
                "coarse_below": 2000.0,
                "rigid_below": 60.0,
                "outside": "rigid",
            }
        ),
        ("shot.level_of_detail",),
        {
            ".enabled": [False],
            ".prim": ["/far"],
            ".image_height": [50.0],
            ".outside": ["full"],
            ".margin": [5.0],
            ".motion": [0.0],
        },
        (".usd", ".start", ".time", ".pixels_per_metre", ".motion", "_below"),
    ),
    "quality by length": Scene(
        {"name": "groom", "row": [ROW | {"count": 5, "region": "wing"}]},
        shot(quality=ROWS | {"guided_below": 1.0, "guided_every": 2, "body_size": 0.06}),
        ("shot.quality.guided_below", "shot.quality.guided_every", "shot.quality.body_size"),
        {".guided_below": [0.0], ".guided_every": [4], ".body_size": [30.0]},
    ),
    "coarse": Scene(
        groom(), shot(quality=ROWS), ("shot.quality.coarse_below",), {".coarse_below": [2.0]}
    ),
    "guided": Scene(
        {"name": "groom", "row": [ROW | {"count": 5, "region": "wing"}]},
        shot(detail=[{"level": "guided", "every": 2, "spacing": 0.01}]),
        ("shot.detail.0.every", "shot.detail.0.spacing"),
        {".every": [1, 4], ".spacing": [1.0]},
    ),
    "places of a skin": Scene(
        groom(skin=SKIN, feather=[FEATHER | {"position": {"vertex": 3}}]),
        shot(**HOLD),
        ("groom.feather.0.position",),
        {".vertex": [7], ".offset": [[0, 0, 0.1]], ".prim": ["/patch"]},
        (".joint", ".primvar"),
    ),
    "place by a primvar": Scene(
        groom(skin=SKIN, feather=[FEATHER | {"position": {"primvar": "mask"}}]),
        shot(**HOLD),
        ("groom.feather.0.position.primvar",),
        {".primvar": ["spot"]},
    ),
    "space": Scene(
        {
            "name": "groom",
            "skin": SKIN,
            "space": {"of": "skin", "left": "y"},
            "region": [REGION | {"where": [WHERE]}],
        },
        shot(**GROWN),
        ("groom.space",),
        {".of": ["body"], ".left": ["-y"]},
    ),
    "carried": Scene(
        {
            "name": "groom",
            "joint": [BODY],
            "wing": [WING | {"joint": "body"}],
            "tail": [TAIL | {"joint": "body"}],
            "crest": [CREST | {"joint": "body"}],
        },
        shot(
            motion={
                "kind": "swing",
                "joints": "body",
                "axis": [0, 1, 0],
                "angle": 20,
                "frequency": 4,
            },
            **RIGID,
        ),
        ("groom.wing.0.joint", "groom.tail.0.joint", "groom.crest.0.joint"),
        {".joint": [""]},
    ),
    "regions by places": Scene(
        {
            "name": "groom",
            "skin": SKIN,
            "region": [
                REGION
                | {
                    "where": [
                        {"nearest": {"to": [[0.1, 0, 0]], "than": [[-0.1, 0, 0]]}, "soft": 0.02},
                        {"sphere": {"centre": [0.05, 0, 0], "radius": 0.06}},
                    ]
                }
            ],
        },
        shot(**GROWN),
        ("groom.region.0.where.0.nearest", "groom.region.0.where.1.sphere"),
        {".to": [[[0.02, 0.1, 0]]], ".than": [[[0.0, 0, 0]]], ".centre": [[0, 0.05, 0]]},
    ),
    "skin with warnings": Scene(
        groom(feather=[FEATHER | {"position": [0, 0, 0.005]}]),
        shot(**SKINNED),
        ("shot.skin.tolerance",),
        {".tolerance": [1e-6]},
    ),
    "long skin": Scene(
        groom(),
        shot(skin=SKINNED["skin"] | {"extrapolation": "hold"}, frames=[2, 5]),
        ("shot.skin.start",),
        {".start": [1]},
    ),
}

# keys that other tests show: parts of paths, and where
ELSEWHERE = {
    "skin.usd": "tests/usdin/test_usd_skin.py",
    ".variant_sets": "tests/usdin/test_stage_choices.py",
    ".subdivision": "tests/usdin/test_subdivided_skins.py",
    ".uv": "tests/usdin/test_texture_space.py",
    ".wrap": "tests/usdin/test_texture_space.py",
    ".purposes": "tests/usdin/test_stage_choices.py",
    ".invisible": "tests/usdin/test_stage_choices.py",
    "max_feathers": "tests/usdin/test_plumage_regions.py",
    ".where.": "tests/usdin/test_plumage_regions.py",
    "kind.where": "tests/usdin/test_plumage_regions.py",
    ".flow.": "tests/usdin/test_plumage_regions.py",
    "region.density": "tests/usdin/test_plumage_regions.py",
    "region.blend": "tests/usdin/test_plumage_regions.py",
    "ids_from": "tests/usdin/test_lasting_ids.py",
    "region.joint": "tests/usdin/test_plumage_regions.py",
    "region.variants": "tests/usdin/test_plumage_regions.py",
    "layout.m": "tests/feather/test_layout.py",
    "max_length_per_free_radius": "tests/usdin/test_plumage_regions.py",
    "bird.": "tests/groom/test_birds.py",
    "body_clearance": "tests/groom/test_lying.py",
    "coverts.loose": "tests/groom/test_wings.py",
    "wing.bands.": "tests/groom/test_wing_bands.py",
    "groom.wing.skeleton": "tests/usdin/test_plumage_rows.py",
    "groom.row.curve.usd": "tests/usdin/test_plumage_rows.py",
    "groom.row.curve.joints": "tests/usdin/test_plumage_rows.py",
    "groom.row.curve.tail": "tests/usdin/test_plumage_rows.py",
    "groom.usd.file": "tests/usdin/test_usd_groom.py",
    "groom.usd.kind": "tests/usdin/test_usd_groom.py",
    "groom.usd.up": "tests/usdin/test_usd_groom.py",
    "groom.usd.names": "tests/usdin/test_usd_groom.py",
    "modulus_along_barbs": "tests/nodal, the lab's model of barbs that stretch",
    "position.joint": "tests/usdin/test_groom_space.py",
    "shot.groom": "tests/usdin/test_usd_groom.py",
    **{
        f"motion.{key}": "tests/usdin/test_motion_curves.py"
        for key in ("usd", "prim", "attribute", "sets", "joint", "order", "time")
    },
    "shot.skin.usd": "tests/usdin/test_usd_skin.py",
    "shot.skin.extrapolation": "tests/usdin/test_usd_skin.py",
    "shot.skin.time": "tests/usdin/test_stage_time.py",
    "shot.cuts": "tests/shot/test_cuts.py",
    "shot.skin.on_collapse": "tests/usdin/test_collapsed_faces.py",
    "shot.collider.time": "tests/usdin/test_stage_time.py",
    "shot.wind_usd": "tests/usdin/test_usd_wind_and_bake.py",
    "shot.collider.map": "tests/usdin/test_texture_space.py",
    "shot.collider.usd": "tests/contact/test_contact_shots.py",
    "shot.collider.interpolation": "tests/contact/test_contact_shots.py",
    "shot.contact.max_steps": "tests/contact/test_contact_encounters.py",
    "shot.contact.skin": "tests/contact/test_contact_shots.py",
    "shot.contact.obstacles": "tests/contact/test_contact_shots.py",
    "shot.sleep": "tests/shot/test_sleep.py",
    "shot.cycle": "tests/flock/test_flock.py",
    "shot.preroll": "tests/shot/test_preroll.py",
    "shot.handles": "tests/usdin/test_stage_time.py",
    "shot.wet.hooks": "tests/shot/test_wet.py",
    "shot.channel.soft": "tests/shot/test_channels.py",
    "shot.target.shape": "tests/shot/test_targets.py",
    "shot.target.frame": "tests/shot/test_targets.py",
    "shot.level_of_detail": "tests/shot/test_levels.py",
    "motion.body": "tests/shot/test_body.py",
    "motion.cites": "tests/shot/test_wing_beat.py",
    "motion.span_ratio": "tests/shot/test_wing_beat.py",
    "motion.heave": "tests/shot/test_wing_beat.py",
    "motion.pitch": "tests/shot/test_driven_joints.py",
    "motion.steady_head": "tests/shot/test_driven_joints.py",
    "motion.planted_feet": "tests/shot/test_driven_joints.py",
    "motion.by_eye": "tests/shot/test_wing_beat.py",
    "motion.fit": "tests/shot/test_motion_fit.py",
    "motion.kind": "tests/shot/test_motion.py",
    "motion.joints": "tests/groom/test_wings.py",
    "quality.contact_tolerance": "tests/contact/test_contact_shots.py",
    "quality.max_substeps": "tests/shot/test_failures.py",
}
# keys that name things: metadata of the stage shows them
LABELS = {"shot.name", "groom.name", "groom.joint.name", "groom.bird"}
