"""Writer of a cache: takes frames, writes one USD cache, complete or not at all."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from featherfx import usd
from featherfx.errors import Problem, SimulationError, warn_input
from featherfx.files.atomic_write import Standing, standing
from featherfx.files.process import Background
from featherfx.limits import describe_large_output
from featherfx.phases import phase
from featherfx.shot.frames import Frame, sample_number
from featherfx.usd.types import (
    ACCELERATIONS,
    DIAGNOSTICS,
    FeatherEntry,
    OutputError,
    StageSpace,
    refuse_unfit_usd,
)
from featherfx.usd.write.chunks import AnimatedPrims, ChunkWriter, WrittenChunk, assemble_cache
from featherfx.usd.write.layers import StageInfo, new_layers
from featherfx.usd.write.options import BY_FEATHER, CHUNK_FRAMES, GROUPINGS, UP_AXES, WriteOptions
from featherfx.usd.write.output import (
    CacheForm,
    check_output,
    choose_group,
    choose_layout,
    group_feathers,
    output_files,
    parts_folder,
    prim_name,
)
from featherfx.usd.write.posed_groups import PosedGroup
from featherfx.usd.write.poses import PosedFeather, make_posed_feathers
from featherfx.usd.write.prims import define_prims
from featherfx.usd.write.unfinished_cache import Parts, Save, list_unfinished_bakes

if TYPE_CHECKING:
    from featherfx.usd.write.previous_cache import PreviousCache

# A chunk is held in memory; large ones get fewer frames, but never less than one. What a chunk
# costs by itself goes with the feathers, so many small ones get more of it.
_MIN_CHUNK_BYTES, _BYTES_PER_FEATHER, _MAX_CHUNK_BYTES = 32_000_000, 40_000, 128_000_000


def chunk_bytes(feathers: int) -> int:
    """Return the bytes of values that a chunk of so many feathers may hold."""
    return min(_MIN_CHUNK_BYTES + _BYTES_PER_FEATHER * feathers, _MAX_CHUNK_BYTES)


def chunk_frames(options: WriteOptions, posed: Sequence[PosedFeather]) -> int:
    """Return the frames of a chunk: as given, or fewer where they would be too large."""
    frame = options.subframes * sum(each.bytes_per_sample for each in posed)
    return max(1, min(options.chunk or CHUNK_FRAMES, chunk_bytes(len(posed)) // frame))


@dataclass(frozen=True)
class CachePlace:
    """Position of a cache's prims.

    root: name of the root prim; "": the file's. part: suffix of group names, where caches with the
    same groups will be joined. origin: m, world (choose_origin of usd/types.py); all below the root
    prim is written relative to it. time_codes_per_second: of its stage; None: frames_per_second.
    handles: first and last frames that are no part of the stage's range.
    """

    root: str = ""
    part: str = ""
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)
    time_codes_per_second: float | None = None
    handles: int = 0


@dataclass(frozen=True)
class Continuation:
    """Settings by which a stopped bake is continued.

    settings: texts of all that the frames depend on; a writer with equal ones may continue. inputs:
    texts of the bake's files, to describe changes to another bake. frames_each: of a chunk, however
    large; None: by the options.
    """

    settings: Mapping[str, str]
    inputs: Mapping[str, str] = field(default_factory=dict)
    frames_each: int | None = None


class CacheWriter:
    """Writer of feathers, and frames of them, to USD; a context manager.

        with CacheWriter("wing.usdc", entries, (1, 24), 24.0, WriteOptions(up_axis="Y")) as writer:
            for frame in simulate(shot):
                writer.write(frame)

    path: .usd, .usdc or .usda. feathers: at least one, unique ids. frames: first and last frame,
    None for a rest pose without time. place: also in time. options: points, velocities and widths
    are converted to the unit and axis, 1 m and "Z" where they are None; layouts are those of
    usd/write/layers.py; a chunk has fewer frames where they exceed chunk_bytes. metadata: plain
    values, stored with the layout as custom data of the root layer.

    continuation: where given, finished chunks stay on disk when the block is left by an exception,
    or the process by a kill. A writer with equal settings and resume continues after them:
    `samples_done` is the number of samples, `state` the file that was written with the last (None:
    nothing to continue from). chunk: samples of each.

    The cache appears complete when the block ends normally; until then, and after an exception, its
    files are as before. Raises OutputError (every problem at once) where the arguments are wrong,
    the output cannot be written, another program wrote it meanwhile or frames are missing.
    """

    def __init__(
        self,
        path: str | Path,
        feathers: Sequence[FeatherEntry],
        frames: tuple[int, int] | None,
        frames_per_second: float = 24.0,
        options: WriteOptions = WriteOptions(),
        *,
        place: CachePlace = CachePlace(),
        metadata: Mapping[str, Any] | None = None,
        continuation: Continuation | None = None,
    ) -> None:
        refuse_unfit_usd()
        self._path = check_output(path, options.overwrite or options.resume, options.layout)
        check_arguments(self._path, feathers, frames, frames_per_second, options)
        self._frames, space = frames, replace(StageSpace.from_options(options), origin=place.origin)
        self._subframes, pixels = options.subframes, options.textures
        self._atlas = usd.materials.Atlas(len(feathers), pixels) if pixels else None
        self._feathers = self._atlas.given_to(feathers) if self._atlas else tuple(feathers)
        extras = {*options.diagnostics, *([ACCELERATIONS] * options.accelerations)}
        form = CacheForm.of(options)
        posed = make_posed_feathers(self._feathers, space, extras, form)
        bytes_per_sample = sum(each.bytes_per_sample for each in posed)
        self._samples = (frames[1] - frames[0]) * self._subframes + 1 if frames else 0
        frames_each = continuation.frames_each if continuation else None
        self.chunk = (frames_each or chunk_frames(options, posed)) * self._subframes
        self._layout = choose_layout(options.layout, bytes_per_sample * self._samples)
        if self._samples and not options.resume:
            needed = bytes_per_sample * self._samples
            smaller = ["--as condensed"] * (not form.thinned)
            smaller += ["--velocities none"] * form.rates
            told = describe_large_output(needed, self._samples, self._path, smaller)
            if told:
                warn_input(told)
        self._info = StageInfo(
            prim_name(place.root or self._path.stem),
            space,
            (frames[0] + place.handles, frames[1] - place.handles) if frames else None,
            frames_per_second,
            {**(metadata or {}), "layout": self._layout}
            | ({"handles": place.handles} if place.handles else {})
            | ({"chunk": self.chunk} if continuation and frames else {}),
            place.time_codes_per_second,
        )
        own = (continuation and continuation.settings) or self._settings_of_stage(options.chunk)
        self._before = self._checked_files(options, own)
        how = choose_group(options.group, len(self._feathers))
        groups = [
            PosedGroup(group, posed, [entry.static for entry in self._feathers], how == BY_FEATHER)
            for group in group_feathers(self._feathers, how, place.part, form.condensed)
        ]
        self._check_finite([k for group in groups for k in group.not_finite(group.rest())], 0.0)
        self._prims = AnimatedPrims.of_cache(groups, self._info.root_path, form)
        self._resumable = continuation is not None
        self._parts: Parts | None = None
        self._earlier: list[PreviousCache] = []
        if frames is not None:
            inputs = continuation.inputs if continuation else None
            self._parts = Parts(self._path, self._layout, own, options.resume, inputs=inputs)
            self._check_unchanged()
            step = 1.0 / (frames_per_second * self._subframes)
            self._chunk = ChunkWriter(self._info, self._prims, step)
        self._taken_over = len(self._parts.records) if self._parts else 0
        self._committing = Background(self._commit, 1)
        self._written: list[WrittenChunk] = []
        self._next, self._given = self.samples_done, len(self._feathers)
        self._is_piece = False

    def __enter__(self) -> CacheWriter:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        with contextlib.ExitStack() as undone:
            undone.callback(self._leave)
            if kind is None and not self._is_piece:
                self._finish()
                undone.pop_all()

    def _leave(self) -> None:
        """Clean up after a failure; finished chunks stay for a resumed bake."""
        with contextlib.suppress(OutputError, OSError):
            self._committing.close()
        for chunk in self._written:
            chunk.file.discard()
        if self._parts and self._resumable and self._parts.records:
            self._parts.close()
        elif self._parts:
            self._parts.discard()

    def take_over(self, earlier: PreviousCache, feathers: Sequence[int]) -> None:
        """Read the samples of some feathers, by their numbers, from an earlier cache.

        Its chunks must have as many samples (`chunk`). Frames then come without these feathers. May
        be called for several caches.
        """
        self._earlier.append(earlier)
        self._given -= len(feathers)
        self._chunk.take_over(earlier, feathers)

    def write_piece(self, first: int) -> None:
        """Take the samples of some chunks only, from one on, 0 the first.

        The block then ends without a cache, and the chunks stay on disk for another writer.
        """
        self._is_piece, self._next = True, first * self.chunk

    def adopt(self, piece: Path) -> None:
        """Take over the next chunks that a writer of the same cache has left at another path.

        That writer has the clips layout. Raises OutputError where none are there, or one is
        damaged.
        """
        assert self._parts is not None
        self._parts.adopt(piece)
        self._next = self.samples_kept

    def tell(self, metadata: Mapping[str, Any]) -> None:
        """Add plain values to the metadata, before the block ends."""
        self._info = replace(self._info, metadata={**self._info.metadata, **metadata})

    @property
    def published(self) -> bool:
        """Return whether the cache has its name."""
        return standing(self._path) != self._before[self._path]

    @property
    def samples_done(self) -> int:
        """Return the samples that are safely on disk, from the first on; waits for pending ones."""
        self._committing.wait()
        return self.samples_kept

    @property
    def samples_kept(self) -> int:
        """Return the samples on disk that a later bake can reuse, also after the block was left."""
        records = self._parts.records if self._parts else []
        return sum(len(record.codes) for record in records)

    @property
    def state(self) -> Path | None:
        """Return the file that was saved with the last finished chunk."""
        if not (self._parts and self._parts.records):
            return None
        return self._parts.state(len(self._parts.records) - 1)

    def write(self, frame: Frame, save: Save | None = None) -> None:
        """Add the next sample: numbers count up by one, or one by subframes, from the first.

        save: writes to a path the state that a resumed bake needs to continue; called where a chunk
        ends. Raises SimulationError if a value is not finite, ValueError for a frame out of turn or
        of other feathers.
        """
        frames = self._frames
        if frames is None or self._next == self._samples or frame.number != self._code:
            raise ValueError(f"frame {frame.number:g} is out of turn. The cache holds {frames}")
        if len(frame.poses) != self._given:
            raise ValueError(f"{len(frame.poses)} feathers given, not {self._given}")
        bad = self._chunk.add(float(frame.number), frame)
        self._check_finite(bad, frame.time)
        self._next += 1
        if self.ends_chunk(self._next - 1):
            # write the chunk in the background while the next frames come
            assert self._parts is not None
            index = self._taken_over + len(self._written)
            self._written.append(self._chunk.write(self._parts.chunk(index)))
            self._committing(self._written[-1], save)

    def ends_chunk(self, sample: int) -> bool:
        """Return whether a chunk, and with it the state for a resumed bake, ends with a sample."""
        return (sample + 1) % self.chunk == 0 or sample + 1 == self._samples

    def _commit(self, chunk: WrittenChunk, save: Save | None) -> None:
        assert self._parts is not None
        self._parts.commit(chunk.finish(), save)

    @property
    def _code(self) -> float:
        """Return the time code of the next sample."""
        assert self._frames is not None
        return sample_number(self._frames[0], self._next, self._subframes)

    def _checked_files(
        self, options: WriteOptions, settings: Mapping[str, str]
    ) -> dict[Path, Standing]:
        """Return the state of the files that the cache will have.

        Existing files are refused, except those of this bake, which a resumed bake replaces.
        """
        begun = list_unfinished_bakes(parts_folder(self._path, self._layout))
        own = self._path.exists() or dict(settings) in [each for each, _ in begun]
        check_output(self._path, options.overwrite or (options.resume and own), self._layout)
        pictures = self._atlas.files(self._path) if self._atlas else []
        if pictures:
            usd.materials.refuse_textures(pictures, options.overwrite)
        files = [*pictures, *output_files(self._path, self._layout)]
        return {file: standing(file) for file in files}

    def _check_unchanged(self) -> None:
        """Refuse files that another bake published before this one had the lock."""
        assert self._parts is not None
        for file, found in self._before.items():
            if standing(file) != found:
                leave = self._parts.close if self._parts.records else self._parts.discard
                leave()
                message = "another bake has just written it. Choose another name, or --overwrite"
                raise OutputError(Problem(str(file), "", message))

    def _settings_of_stage(self, chunk: int | None) -> dict[str, str]:
        """Return settings that tell caches of the same name apart where none are given."""
        space, info = self._info.space, self._info
        rates = info.frames_per_second, info.time_codes_per_second
        values = (space, info.frames, rates, info.metadata, self._subframes, chunk)
        return {"stage": repr(values)}

    def _finish(self) -> None:
        frames = self._frames
        with phase("writing", silent=True):
            self._committing.close()
        if frames is not None and self._next < self._samples:
            message = f"not written: frames {self._code:g} to {frames[1]} never came"
            raise OutputError(Problem(str(self._path), "frames", message))
        if self._parts:
            # Samples are on disk; their memory is wanted for what is constant.
            del self._chunk
        for earlier in self._earlier:
            earlier.close()
        with phase("finishing", 2.0) as done:
            layers = new_layers(self._info, self._layout)
            atlas, path = self._atlas, self._path
            texture = atlas.asset(path) if atlas else ""
            define_prims(layers.topology, self._info, self._feathers, self._prims, texture)
            done(1)
            pictures = atlas.stored(path, self._feathers) if atlas else ()
            assemble_cache(
                layers, self._info, self._prims, path, self._parts, self._before, pictures
            )
            if self._parts:
                self._parts.finish(keep_chunks=self._layout == "clips")

    def _check_finite(self, bad: Sequence[int], time: float) -> None:
        for index in bad:
            reason = "a position or velocity is not finite, or too large for single precision"
            raise SimulationError(self._feathers[index].id, time, reason)


def check_arguments(
    path: Path,
    feathers: Sequence[FeatherEntry],
    frames: tuple[int, int] | None,
    frames_per_second: float,
    options: WriteOptions,
) -> None:
    """Raise OutputError with every problem of the arguments."""
    wrong: list[tuple[str, str]] = []
    if not feathers:
        wrong.append(("feathers", "none given; a cache holds at least one"))
    seen: set[str] = set()
    for entry in feathers:
        if entry.id in seen:
            wrong.append(("feathers", f"id '{entry.id}' is used twice. Give unique ids"))
        seen.add(entry.id)
        expected, shape = (each.nodes.shape for each in (entry.feather.rest, entry.rest_points))
        if shape != expected:
            wrong.append(("feathers", f"'{entry.id}': rest points {shape}, not {expected}"))
    if frames is not None and frames[0] > frames[1]:
        wrong.append(("frames", f"first frame {frames[0]} is after the last, {frames[1]}"))
    values = {"frames_per_second": frames_per_second, "meters_per_unit": options.meters_per_unit}
    for key, value in {**values, "chunk": options.chunk, "subframes": options.subframes}.items():
        if value is not None and not (math.isfinite(value) and value > 0):
            wrong.append((key, f"{value} is not a finite number above 0"))
    for key, allowed in {"up_axis": UP_AXES, "group": GROUPINGS}.items():
        if (name := getattr(options, key)) not in (None, *allowed):
            wrong.append((key, f"'{name}' is not one of {', '.join(allowed)}"))
    wrong += [
        ("diagnostics", f"'{name}' is not one of {', '.join(DIAGNOSTICS)}")
        for name in options.diagnostics
        if name not in DIAGNOSTICS
    ]
    if wrong:
        raise OutputError(*(Problem(str(path), key, message) for key, message in wrong))
