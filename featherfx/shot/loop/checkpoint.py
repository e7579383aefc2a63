"""The memory of a simulation between two frames, on disk: what a bake continues from."""

from __future__ import annotations

import zipfile
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from featherfx.algebra.types import Array, Indices
from featherfx.errors import InputError, Problem, require_type
from featherfx.files.atomic_write import write_whole
from featherfx.shot.loop.run import Arrays, prefixed, under
from featherfx.solver.state import State


@dataclass(frozen=True)
class Checkpoint:
    """State of a simulation after a sample.

    index: number of the sample, 0 at the first frame, counted in frames times subframes.
    states: one per group of feathers. starts: per group (F, n, 1 + 2 m, 3) m, nodes at the
    first frame, from which grips count. stages: arrays that the stages of the frame loop keep, by
    their names. wanted: (W,) numbers of the feathers in its frames.
    """

    index: int
    states: tuple[State, ...]
    starts: tuple[Array, ...]
    stages: dict[str, Arrays] = field(default_factory=dict)
    wanted: Indices = field(default_factory=lambda: np.zeros(0, dtype=np.int64))

    def save(self, path: str | Path) -> None:
        """Write it to an .npz file, whole or not at all."""
        arrays = {"index": np.array(self.index), "groups": np.array(len(self.states))}
        arrays |= {"wanted": self.wanted}
        for k, (state, start) in enumerate(zip(self.states, self.starts, strict=True)):
            arrays |= prefixed(f"{k}.", state.arrays()) | {f"{k}.start": start}
        for name, own in self.stages.items():
            arrays |= prefixed(f"{name}/", own)
        write_whole(Path(path), lambda file: np.savez(file, **arrays))  # type: ignore[arg-type]

    @staticmethod
    def load(path: str | Path) -> Checkpoint:
        """Read what save wrote. Raises InputError where the file is not that."""
        require_type("path", path, str | Path, "the path of a file that Checkpoint.save wrote")
        try:
            with np.load(path, allow_pickle=False) as file:
                groups = range(int(file["groups"]))
                states = tuple(State.from_arrays(under(f"{k}.", file)) for k in groups)
                starts = tuple(file[f"{k}.start"] for k in groups)
                names = sorted({name.partition("/")[0] for name in file if "/" in name})
                stages = {name: under(f"{name}/", file) for name in names}
                return Checkpoint(int(file["index"]), states, starts, stages, file["wanted"])
        except FileNotFoundError:
            told = "there is no such file. Check the path"
            raise InputError(Problem(str(path), "", told)) from None
        except (OSError, KeyError, ValueError, zipfile.BadZipFile) as error:
            lacks = f": {error}" if isinstance(error, KeyError) else ""
            told = f"is no checkpoint{lacks}. Give a file that Checkpoint.save wrote"
            raise InputError(Problem(str(path), "", told)) from error
