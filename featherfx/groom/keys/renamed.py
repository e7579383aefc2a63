"""Old names of keys, and the names that replaced them."""

from __future__ import annotations

import re
from collections.abc import Container
from typing import NamedTuple

# table of a file or preset, old name, new name
RENAMED = (
    ("rachis_material", "young", "youngs_modulus"),
    ("rachis_material", "shear", "shear_modulus"),
    ("rachis_material", "wall", "cortex_fraction"),
    ("vane_material", "along", "modulus_along_barbs"),
    ("vane_material", "across", "modulus_across_barbs"),
    ("vane_material", "shear", "shear_modulus"),
    ("vane_material", "along_profile", "along_barbs_profile"),
    ("vane_material", "across_profile", "across_barbs_profile"),
    ("vane_material.thickness_profile", "shaft", "rachis"),
    ("vane_material", "poisson", "poissons_ratio"),
    ("vane_material", "hook_heal", "hook_healing_rate"),
    ("leading.hooked", "shaft", "rachis"),
    ("leading.splits", "number", "count"),
    ("colour", "shaft", "rachis"),
    ("colour", "vary", "brightness_variation"),
    ("colour.patterns", "number", "count"),
    ("barbs", "clumps", "clump_count"),
    ("skin", "most", "max_feathers"),
    ("region", "fit", "max_length_per_free_radius"),
    ("region.where", "room", "free_radius"),
    ("row", "overlap", "lift"),
    ("row", "transport", "turn_with_path"),
    ("variation", "across", "modulus_across_barbs"),
    ("variation", "along", "modulus_along_barbs"),
    ("variation", "angle", "barb_angle"),
    ("wing.type", "clear", "body_clearance"),
    ("wing.type.coverts", "place", "chord_position"),
    ("bird.type", "parts", "tracts"),
    ("bird.type.tracts.breast", "cover", "relative_density"),
    ("bird.type.tracts.breast", "uneven", "length_variation"),
    ("bird.type.disc", "cover", "relative_density"),
    ("bird.type.disc", "rim_cover", "rim_relative_density"),
    ("quality", "radius", "spectral_radius"),
    ("quality", "body", "body_size"),
    ("motion", "rise", "ramp_periods"),
    ("motion", "lag", "phase"),
    ("motion", "parts", "motions"),
    ("contact", "most_steps", "max_steps"),
    ("skin", "radius", "smoothing_radius"),
    ("skin", "beyond", "extrapolation"),
    ("wet", "clumps", "clump_count"),
    ("preen", "along", "direction"),
    ("preen", "closes", "closed_fraction"),
    ("preen", "reach", "max_gap"),
    ("", "free", "detach"),
)
# key of a file or preset, and what to do instead
REMOVED = {
    "coast": "Delete it: featherfx simulates feathers that move evenly with their roots, too.",
    "twins": "Delete it: featherfx simulates feathers that move alike one by one.",
    "contact.forces": "Delete it. Leave [contact] out if feathers push nothing.",
    "contact.layers": "Delete it: feathers on a skin keep their leaves in all that is written.",
    "contact.layered": "Delete it: all feathers on a skin keep their leaves.",
    "contact.ease": "Delete it: feathers keep their leaves without lifts that come and go.",
    "level_of_detail.fade": "Delete it: a feather's largest size in the shot chooses its level.",
    **{
        f"tracts.{part}": "Delete it: the coat rises onto folded wings, as their small coverts."
        for part in ("wrist", "breast_side")
    },
    "layout.clearance": "Write layout.gap, a share of the length of the feathers.",
    "layout.most_tilt": "Delete it: feathers bend onto their leaves (layout.thickness).",
    "layout.most_tilt_placed": "Delete it: rows stay as they are placed.",
    "layout.most_lift": "Delete it: feathers bend onto their leaves (layout.thickness).",
    "layout.least_size": "Delete it: no feather of a layout is shortened.",
    "layout.drop": "Delete it: no feather of a layout is left out.",
    "ramp_beats": "Delete it: beats go on from before the first frame, or number beats.",
    "period": "Write wingbeat_frequency, one over it.",
    "shoulder_amplitude": "Write stroke_amplitude, twice as much.",
    "shoulder_offset": "Write elevation = { mean = ... }.",
    "shoulder_sweep": "Write sweep = { harmonics = [[..., 0]] }.",
    **{
        f"{joint}_{what}": f"Write {joint} = {{ mean = ..., harmonics = [[cos, sin]] }}."
        for joint in ("elbow", "wrist")
        for what in ("amplitude", "offset", "phase")
    },
    "region.layer": "Delete it: feathers lie over each other by where they start along the flow.",
    "wing.layer": "Delete it: its feathers stay as they are placed.",
    "row.layer": "Delete it: its feathers stay as they are placed.",
    "tail.layer": "Delete it: its feathers stay as they are placed.",
    "crest.layer": "Delete it: its feathers stay as they are placed.",
}

# names that other programs have for keys
SYNONYMS = {
    "camera": "level_of_detail",
    "end": "frames",
    "fps": "frames_per_second",
    "hooked": "hooks",
    "intensity": "speed",
    "start": "frames",
    "strength": "speed",
    "turbulence": "gust",
}

_INDEX = re.compile(r"\[\d+\]")


class OldKey(NamedTuple):
    """A key that no longer exists. new: the key that replaces it, itself if none does."""

    new: str
    message: str


def explain_old_key(path: str, known: Container[str]) -> OldKey | None:
    """Find what became of an unknown key. known: keys of its table."""
    path = _INDEX.sub("", path)
    name = path.rpartition(".")[2]
    for _, old, new in RENAMED:
        if old == name and new in known:
            return OldKey(new, f"was renamed. Write {new}.")
    for old, advice in REMOVED.items():
        if path == old or path.endswith(f".{old}"):
            return OldKey(name, f"was removed. {advice}")
    return None
