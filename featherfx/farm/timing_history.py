"""Time of the shares of a shot in earlier jobs of this machine, by which later ones order them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from featherfx.files.disk_cache import keep, kept_before

_WHAT = "share-times"


def seconds_of(shot: Path, sizes: Sequence[int]) -> list[float]:
    """Processor s that a sample of each of a shot's shares took when it was last baked in such
    shares; none where it was not. sizes: feathers of each."""
    found = kept_before(_WHAT, [str(shot), list(sizes)])
    return [] if found is None else found["seconds"].tolist()


def note(shot: Path, sizes: Sequence[int], seconds: Sequence[float]) -> None:
    """Remember what a sample of each share took."""
    keep(_WHAT, [str(shot), list(sizes)], {"seconds": list(seconds)})
