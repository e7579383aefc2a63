"""The packages of a shot: what each one does, what asks for it, and what it brings.

The frame loop knows none of them. It imports a package only if the shot has one of the tables that
ask for it, by the names in this file. Packages act in the order of this file.
"""

from __future__ import annotations

from importlib import import_module
from operator import attrgetter
from typing import Any, NamedTuple

_SHOT = "featherfx.shot."


class Package(NamedTuple):
    """A feature that a shot may need. What it brings are names, `module:name` below featherfx.shot.

    tables: attributes of a shot, of which one that is set asks for the package; none: every shot
    has it. stages: parts of the frame loop, and loads: what acts on feathers (shot/loop/run.py).
    levels: what changes levels of detail (shot/detail/guides.py). roots: what changes the motion of
    roots, (shot, Roots) -> Roots. dependences: what the motion of each feather depends on, (shot,
    Roots) -> values, None for none; spreads: the same of what it shares with others, (shot,
    ShotOptions, texts) -> texts (shot/motion/motion.py).
    """

    name: str
    offers: str
    tables: tuple[str, ...] = ()
    stages: tuple[str, ...] = ()
    loads: tuple[str, ...] = ()
    levels: tuple[str, ...] = ()
    roots: tuple[str, ...] = ()
    dependences: tuple[str, ...] = ()
    spreads: tuple[str, ...] = ()


PACKAGES = (
    Package(
        "core",
        "Feathers that are stepped one by one under gravity, wind, grips and forces.",
        stages=("loop.run:ErrorStage",),
    ),
    Package(
        "grips",
        "Points that are led along a path by a spring.",
        tables=("grips",),
        stages=("loop.holds:GripStage",),
    ),
    Package(
        "cuts",
        "Cuts of the animation, at which everything goes on from another pose.",
        tables=("has_moving_roots", "colliders"),
        stages=("loop.skin_stages:CutStage",),
    ),
    Package(
        "drawn skin",
        "Roots that stand on the skin as a renderer draws it, between its own frames.",
        tables=("skin",),
        stages=("loop.skin_stages:DrawnSkinStage",),
    ),
    Package(
        "levels",
        "Levels of detail by table, length or camera; guided and rigid feathers.",
        tables=("details", "level_of_detail", "quality.guided_below", "quality.rigid_below"),
        stages=("detail.guided:FollowerStage",),
        levels=("detail.guides:refine_levels",),
        spreads=("detail.guides:add_guides",),
    ),
    Package(
        "contact",
        "Feathers that push each other, the skin and colliders.",
        tables=("contact",),
        stages=("contact.contact_group:ContactStage",),
        spreads=("contact.partition:add_islands",),
    ),
    Package(
        "hooks",
        "Vanes that open between barbs, and strokes and healing that close them.",
        tables=("preens", "has_slipping_hooks"),
        stages=("loop.hooks:HookStage",),
    ),
    Package(
        "targets",
        "Feathers that are brought to a shape.",
        tables=("targets",),
        stages=("direction.targets:TargetStage",),
        loads=("direction.targets:TargetLoads",),
        dependences=("direction.targets:depend_on_targets",),
    ),
    Package(
        "channels",
        "Feathers that are directed over time: turned, stiffened, calmed, exaggerated.",
        tables=("channels",),
        stages=("direction.channels:FollowThrough",),
        loads=("direction.channels:WindLoads", "direction.channels:MaterialLoads"),
        roots=("direction.roots:direct_roots",),
        dependences=("direction.roots:depend_on_channels",),
    ),
    Package(
        "wetness",
        "Feathers that are wet: heavier, with weaker hooks and clumped barbs.",
        tables=("wets",),
        stages=("loop.hooks:ClumpStage",),
        loads=("loop.hooks:WetLoads",),
    ),
    Package(
        "shelter",
        "Wind that a plumage keeps off its feathers.",
        tables=("shelters", "has_sheltered_feathers"),
        loads=("loop.shelter:ShelterLoads",),
    ),
    Package(
        "free flight",
        "Feathers that leave their roots and fall.",
        tables=("detachments",),
        loads=("loop.holds:FreeFlight",),
    ),
    Package(
        "coat",
        "Feathers on a moving skin that keep their leaves over it.",
        tables=("has_coat_on_skin",),
        stages=("coat.stage:CoatStage",),
    ),
)

# what moves the roots of a shot, by the kind of its motion: (motion, shot, skeleton) -> poses
MOTION_SOURCES = {
    "hold": "motion.joints:held",
    "shake": "motion.beat:shaken",
    "swing": "motion.beat:swung",
    "level": "motion.beat:levelled",
    "flap": "motion.flap:flapping",
    "fold": "motion.flap:folded",
    "keys": "motion.keys:keyed",
    "curve": "motion.keys:followed",
    "act": "motion.act:acted",
}


def load_name(name: str) -> Any:
    """Import what a name of this file stands for."""
    module, _, attribute = name.partition(":")
    return getattr(import_module(_SHOT + module), attribute)


def is_asked(package: Package, shot: Any) -> bool:
    """Return whether a shot asks for a package."""
    return not package.tables or any(attrgetter(table)(shot) for table in package.tables)


def brought(shot: Any, what: str) -> list[Any]:
    """List what the packages of a shot bring, in their order; what: a field of Package."""
    return [
        load_name(name)
        for package in PACKAGES
        if getattr(package, what) and is_asked(package, shot)
        for name in getattr(package, what)
    ]
