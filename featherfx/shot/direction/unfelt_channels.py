"""Channels that act otherwise than asked: on guided and rigid feathers, of which nothing is solved,
and on coats without a skin."""

from __future__ import annotations

import warnings
from collections.abc import Sequence

import numpy as np

from featherfx.errors import InputWarning
from featherfx.shot.direction.channels import courses
from featherfx.shot.options.options import FeatherOptions
from featherfx.shot.types import CHANNELS, Shot

# channels that act within the simulation, or on what comes of it
FELT = ("stiffness", "damping", "wind", "gravity", "follow")
# those that raise or turn the leaves of a coat together
_TOGETHER = ("ruffle", "sleek", "turn", "puff")


def warn_of_unfelt(shot: Shot, options: Sequence[FeatherOptions]) -> None:
    """Warn of channels that none of their feathers feels.

    options: of each feather.
    """
    solved = np.array([each.is_simulated for each in options], dtype=np.bool_)
    guided = np.array([each.level == "guided" for each in options], dtype=np.bool_)
    for course in courses(shot, FELT):
        name, own = course.channel.name, course.weights > 0.0
        felt = solved | guided if name == "follow" else solved
        acts = bool((course.curve.values != CHANNELS[name].neutral).any())
        if acts and own.any() and not (own & felt).any():
            number = next(k for k, each in enumerate(shot.channels) if each is course.channel)
            which = "simulated or guided" if name == "follow" else "simulated"
            message = f"none of its {int(own.sum())} feathers is {which}, so none feels {name}"
            message += ". Give them another level in [[detail]]"
            warnings.warn(f"{shot.source}: channel[{number}]: {message}", InputWarning, 2)
    if shot.skin is None and shot.groom.coat is not None:
        coat = np.array([each.leaf is not None for each in shot.groom.feathers], dtype=np.bool_)
        apart = [(course.weights != 0.0) & coat for course in courses(shot, _TOGETHER)]
        if apart and (count := int(np.any(apart, axis=0).sum())):
            warnings.warn(
                f"{shot.source}: channel: {count} feathers of the coat turn one by one and may pass"
                " through each other, as the shot has no [skin]. Add one with the groom's skin",
                InputWarning,
                2,
            )
