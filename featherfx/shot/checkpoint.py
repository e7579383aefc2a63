"""The solver's whole memory between two frames, on disk: what a bake continues from."""

from __future__ import annotations

import zipfile
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from featherfx.algebra.types import Array, Indices
from featherfx.errors import InputError, Problem
from featherfx.files.atomic_write import write_whole
from featherfx.shot.frames import FeatherPose
from featherfx.solver.state import State

NOWHERE: Array = np.zeros((0, 3))

_KEPT = ("contact", "cycles", "layers")


@dataclass(frozen=True)
class Checkpoint:
    """Where a simulation stands after a sample.

    index: number of the sample, 0 at the first frame, counted in frames times subframes.
    states: one per group of feathers. starts: per group (F, n, 1 + 2 m, 3) m, nodes at the
    first frame, from which grips count. wanted: (W,) numbers of the feathers in its frames;
    replayed: (R,) of those whose motion was taken from an earlier simulation.
    contact, cycles, layers: arrays that contact, repeated motion and layered plumage keep between
    frames.
    """

    index: int
    states: tuple[State, ...]
    starts: tuple[Array, ...]
    contact: dict[str, NDArray[Any]] = field(default_factory=dict)
    cycles: dict[str, NDArray[Any]] = field(default_factory=dict)
    layers: dict[str, NDArray[Any]] = field(default_factory=dict)
    wanted: Indices = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    replayed: Indices = field(default_factory=lambda: np.zeros(0, dtype=np.int64))

    def save(self, path: Path) -> None:
        """Write it to an .npz file, whole or not at all."""
        arrays = {"index": np.array(self.index), "groups": np.array(len(self.states))}
        arrays |= {"wanted": self.wanted, "replayed": self.replayed}
        for k, (state, start) in enumerate(zip(self.states, self.starts, strict=True)):
            arrays |= {f"{k}.{name}": value for name, value in state.arrays().items()}
            arrays[f"{k}.start"] = start
        for kind in _KEPT:
            kept = getattr(self, kind)
            arrays |= {f"{kind}.{name}": value for name, value in kept.items()}
        write_whole(path, lambda file: np.savez(file, **arrays))  # type: ignore[arg-type]

    @staticmethod
    def load(path: Path) -> Checkpoint:
        """Read what save wrote. Raises InputError where the file is not that."""
        try:
            with np.load(path, allow_pickle=False) as file:
                groups = range(int(file["groups"]))
                states = tuple(State.from_arrays(_under(f"{k}.", file)) for k in groups)
                starts = tuple(file[f"{k}.start"] for k in groups)
                kept = {kind: _under(f"{kind}.", file) for kind in _KEPT}
                index, wanted, replayed = int(file["index"]), file["wanted"], file["replayed"]
                return Checkpoint(index, states, starts, **kept, wanted=wanted, replayed=replayed)
        except (OSError, KeyError, ValueError, zipfile.BadZipFile) as error:
            raise InputError(Problem(str(path), "", f"is no checkpoint: {error}")) from error


class Reach(NamedTuple):
    """A sample that is simulated, before it is laid: its number, poses of the feathers that are
    computed, (V, 3) m, the skin beneath them, a checkpoint without what layers keep, None where
    nobody asks for it, and by number what a later bake may replay."""

    sample: int
    poses: list[FeatherPose]
    skin: Array
    standing: Checkpoint | None
    solved: dict[int, FeatherPose]


def _under(prefix: str, file: Mapping[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
    """The arrays whose names begin with a prefix, without it."""
    return {n.removeprefix(prefix): file[n] for n in file if n.startswith(prefix)}
