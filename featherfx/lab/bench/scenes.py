"""Scenes on which the front of error against work is measured: six kinds, none of them a sample.

Each is a groom and a shot as files of the program, so that what is measured is what a bake does.
"""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory

from featherfx.shot.read.read import read_shot
from featherfx.shot.types import Shot

_PRIMARY = """
[[feather]]
id = "primary"
kind = "swan_primary"
position = [0, 0, 0]
direction = [1, 0, 0]
up = [0, 0, 1]
"""
_OTHERS = """
[[feather]]
id = "covert"
kind = "covert"
position = [0, 1, 0]
direction = [1, 0.2, 0]
up = [0, 0, 1]

[[feather]]
id = "owl"
kind = "owl_primary"
position = [0, 2, 0]
direction = [1, -0.3, 0.2]
up = [0, 0, 1]

[[feather]]
id = "contour"
kind = "body_contour"
position = [0, 3, 0]
direction = [1, 0, 0.5]
up = [0, 0, 1]
"""
_PLUMES = """
[[feather]]
id = "plume"
kind = "ornamental_plume"
position = [0, 0, 0]
direction = [0, 0.3, 1]
up = [-1, 0, 0]
scale = 0.7

[[feather]]
id = "soft"
kind = "swan_primary"
position = [0, 1, 0]
direction = [1, 0, 0.3]
up = [0, 0, 1]
overrides = { rachis_material = "measured_rachis", vane_material = "plume_vane" }
"""
_WING = """
[[joint]]
name = "body"
position = [0, 0, 0]
role = "body"

[[joint]]
name = "shoulder"
position = [0, 0.05, 0]
parent = "body"
role = "shoulder"
side = "left"

[[joint]]
name = "elbow"
position = [0, 0.2, 0]
parent = "shoulder"
role = "elbow"
side = "left"

[[joint]]
name = "wrist"
position = [0, 0.4, 0]
parent = "elbow"
role = "wrist"
side = "left"

[[row]]
id = "feather"
kind = "swan_primary"
count = 3
first = { position = [0, 0.42, 0], direction = [-1, 0.2, 0], up = [0, 0, 1] }
last = { position = [0, LAST, -0.003], direction = [-1, SPREAD, 0], up = [0, 0, 1] }
scale = [0.5, 0.8]
joint = "wrist"
"""
_STILL = "wind = 'calm'\n"
_VACUUM = "gravity = [0, 0, 0]\n[wind]\nbase = 'calm'\nair_density = 0\n"

# name: groom, shot
SCENES = {
    "shake in vacuum": (
        _PRIMARY + _OTHERS,
        "motion = { base = 'shake', amplitude = 0.05, direction = [0, 0, 1] }\n" + _VACUUM,
    ),
    "flap": (
        _WING.replace("LAST", "0.6").replace("SPREAD", "0.6"),
        "motion = { base = 'flap', period = 0.5 }\n" + _STILL,
    ),
    "gust": (
        _PRIMARY + _OTHERS,
        "[wind]\nbase = 'gust'\nspeed = 3\ndirection = [-0.2, 0.1, 1]\n",
    ),
    "pull": (
        _PRIMARY + _OTHERS,
        _STILL
        + "".join(
            f"[[grip]]\nfeather = '{name}'\ndisplacement = {way}\nend = 0.8\nstiffness = 300\n"
            for name, way in (
                ("primary", [-0.01, 0.05, 0.05]),
                ("covert", [-0.005, 0.02, -0.03]),
                ("owl", [-0.01, 0.0, 0.08]),
                ("contour", [-0.002, 0.0, 0.02]),
            )
        ),
    ),
    "contact": (
        _WING.replace("LAST", "0.46").replace("SPREAD", "0.3").replace("= 3", "= 2"),
        "motion = { base = 'flap', period = 0.5 }\n" + _STILL + "[contact]\n",
    ),
    "soft plume": (_PLUMES, "[wind]\nbase = 'breeze'\ndirection = [1, 0.2, 0]\ngust = 0.4\n"),
}
FRAMES = {name: 13 if name == "contact" else 25 for name in SCENES}


def scene(name: str) -> Shot:
    """A shot of a second, of half of one where feathers touch."""
    groom, shot = SCENES[name]
    head = f'name = "{name}"\ngroom = "groom.toml"\nframes = [1, {FRAMES[name]}]\n'
    with TemporaryDirectory() as folder:
        Path(folder, "groom.toml").write_text(f'name = "{name}"\n{groom}', encoding="utf-8")
        Path(folder, "shot.toml").write_text(head + shot, encoding="utf-8")
        return read_shot(Path(folder, "shot.toml"))
