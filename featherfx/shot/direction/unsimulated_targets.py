"""Targets and channels of feathers that are not simulated: guided and rigid ones feel no forces."""

from __future__ import annotations

import warnings
from collections.abc import Sequence

import numpy as np

from featherfx.errors import InputWarning
from featherfx.shot.direction.channels import courses
from featherfx.shot.options.options import FeatherOptions
from featherfx.shot.patterns import fits
from featherfx.shot.types import CHANNELS, Shot

# channels that act within the simulation, or on what comes of it
FELT = ("stiffness", "damping", "wind", "gravity", "follow")


def warn_of_unfelt(shot: Shot, options: Sequence[FeatherOptions]) -> None:
    """Say which targets some of their feathers do not feel, and which channels none of theirs does.

    options: of each feather.
    """
    felt = np.array([each.is_simulated for each in options], dtype=np.bool_)
    for number, target in enumerate(shot.targets):
        own = np.array([fits(target, each) for each in shot.groom.feathers], dtype=np.bool_)
        if deaf := int((own & ~felt).sum()):
            told = f"{deaf} of its {int(own.sum())} feathers are guided or rigid and feel no target"
            _warn(shot, f"target[{number}]", told)
    for course in courses(shot, FELT):
        name, own = course.channel.name, course.weights > 0.0
        acts = bool((course.curve.values != CHANNELS[name].neutral).any())
        if acts and own.any() and not (own & felt).any():
            number = next(k for k, each in enumerate(shot.channels) if each is course.channel)
            told = f"none of its {int(own.sum())} feathers is simulated, so none feels {name}"
            _warn(shot, f"channel[{number}]", told)


def _warn(shot: Shot, key: str, told: str) -> None:
    hint = "Give them another level in [[detail]]"
    warnings.warn(f"{shot.source}: {key}: {told}. {hint}", InputWarning, stacklevel=3)
