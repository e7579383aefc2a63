"""A shot that is simulated while it is looked at: presets change, feathers are pulled and blown."""

from __future__ import annotations

import json
import re
import shutil
import struct
import threading
import time
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import nullcontext
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from featherfx.algebra.types import Array
from featherfx.api import read_quality, read_shot
from featherfx.baking.entries import entries_of
from featherfx.errors import InputError, Problem, SimulationError
from featherfx.feather.types import both
from featherfx.files.disk_cache import Aside
from featherfx.groom.keys.preset import PRESET_FAMILIES
from featherfx.groom.keys.problems import Place, Problems
from featherfx.groom.presets.library import Library
from featherfx.groom.read.toml_file import load_toml
from featherfx.groom.types import Placement
from featherfx.render.geometry import DrawnPose
from featherfx.shot.frames import FeatherPose, Frame, place
from featherfx.shot.loop.live import JoinedSurfaces, LiveSimulation
from featherfx.shot.patterns import Grip
from featherfx.shot.types import Shot
from featherfx.usd.write.cache_writer import CacheWriter
from featherfx.view.page import BYTES, HTML, JSON, Server, page
from featherfx.view.played import STRAIN, Played
from featherfx.view.tuned import Tuned

_MAX_FEATHERS = 5_000
# s without a page that asks, after which the simulation waits
_PATIENCE = 2.0
# frames that a shot goes on after its last one, where nothing in it is read from a file
_ENDLESS = 1_000_000
# N/m of the spring between a feather and the mouse
_PULL = 50.0
# frames a second that are simulated where the shot has fewer, so that motion is smooth, of so many
# feathers at most; and s between two figures of their energy
_SMOOTH, _FEW, _ENERGY_EVERY = 48.0, 200, 0.25
_LIVE = re.compile(r"(points|strain)-after-(\d{1,12})")


@dataclass(frozen=True)
class LiveSource:
    """Shot and settings of a live simulation. shot: its file. feathers: patterns of ids, all by
    default. quality: name of a preset. folders: of presets. jobs: threads. folder: for what is
    needed meanwhile."""

    shot: Path
    folder: Path
    feathers: Sequence[str] = ()
    quality: str = "draft"
    folders: Sequence[Path] = ()
    jobs: int = 1


class Made(NamedTuple):
    """A simulation that was set up. triangles: of all feathers, corners by feather. points, barbs:
    (V, 3), (T, 3), as of DrawnPose, at rest. often: samples a frame. surfaces: of all feathers."""

    shot: Shot
    simulation: LiveSimulation
    often: int
    surfaces: JoinedSurfaces
    triangles: Array
    points: Array
    barbs: Array


class Live:
    """Simulates a shot for a page, in threads of its own, as fast as it plays and no faster.

    tuned: presets of it that may be changed. A context manager that ends the threads. Raises
    InputError where the shot cannot be read.
    """

    def __init__(self, source: LiveSource, tuned: Tuned) -> None:
        self.tuned, self._source = tuned, source
        self._asked, self._number, self._version = time.monotonic(), 0, 0
        self._told: dict[str, Any] = {}
        self._aside = Aside()
        self._points, self._problem = np.zeros((0, 3)), ""
        # stuck: no frame follows until something is changed
        self._ended = self._stuck = False
        # numbers of changes: asked for, prepared and simulated; of restarts: asked for and done
        self._wanted = self._prepared = self._generation = self._restarts = self._restarted = 0
        self._next: tuple[Made, int] | None = None
        self._pull: tuple[Grip, Array] | None = None
        self._wind: tuple[Array, float] | None = None
        self._speed = 1.0
        self._news = threading.Condition()
        self._made = self._make()
        self._samples = self._made.simulation.live_samples()
        self._frame = next(self._samples)()
        self.played = self._drawn(self._made, self._frame)
        self._energy_at = -np.inf
        self._drawer = ThreadPoolExecutor(1)
        self._drawing: Future[None] | None = None
        self._show(self._made, lambda: self._frame, self._figures(0.0))
        self._threads = [
            threading.Thread(target=each, daemon=True) for each in (self._step, self._prepare)
        ]

    def __enter__(self) -> Live:
        for thread in self._threads:
            thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        with self._news:
            self._ended = True
            self._news.notify_all()
        for thread in self._threads:
            thread.join()
        self._drawer.shutdown()

    @property
    def name(self) -> str:
        return self._made.shot.name

    def header(self) -> dict[str, Any]:
        """As of Played, with the sliders."""
        sliders = [each._asdict() for each in self.tuned.sliders]
        with self._news:
            own = {"name": self.name, "live": True, "version": self._version, "sliders": sliders}
            return self.played.header() | own

    def after(self, number: int, value: str = "", patience: float = 5.0) -> bytes:
        """The newest frame, once it is a later one than this; the same after so many seconds.

        value: that is wanted of its points besides. The number of bytes of a JSON object (uint32),
        the object, padded to 4 bytes, the frame, the value.
        """
        with self._news:
            self._asked = time.monotonic()
            self._news.notify_all()
            self._news.wait_for(lambda: self._number > number or self._ended, patience)
            text = json.dumps(self._told | {"number": self._number, "problem": self._problem})
            points, played = self._points, self.played
        told = text.encode() + b" " * (-len(text) % 4)
        values = [played.valued(value, points)] if value else []
        return b"".join([struct.pack("<I", len(told)), told, played.packed(points), *values])

    def change(self, key: str, value: Any) -> None:
        """Set a value of a preset. Raises InputError where it is not allowed."""
        with self._news:
            self.tuned.change(key, value)
            self._wanted += 1
            self._news.notify_all()

    def restart(self) -> None:
        """Begin again at the first frame, at rest."""
        with self._news:
            self._restarts += 1
            self._wanted += 1
            self._news.notify_all()

    def play_at(self, speed: float) -> None:
        """So many times real time. Raises ValueError where that is no number from 0.01 to 10."""
        if not 0.01 <= speed <= 10.0:
            raise ValueError(speed)
        self._speed = float(speed)

    def blow(self, direction: Any, speed: float) -> None:
        """Let a wind of so many m/s blow instead of the shot's; None: the shot's again. Raises
        InputError where that is no wind."""
        if direction is None:
            self._wind = None
            return
        problems, keys = Problems(), PRESET_FAMILIES["wind"].keys
        wind = [
            keys[key].type.check(value, Place("tune", key, problems), False)
            for key, value in (("direction", direction), ("speed", speed))
        ]
        problems.raise_any()
        self._wind = np.array(wind[0]), wind[1]

    def pull(self, feather: int | None, at: Any, to: Any) -> None:
        """Take a feather, of those shown, where it is nearest to a place, and lead it to another;
        if it is held already, go on with that. None: let go. Raises ValueError or IndexError."""
        if feather is None:
            self._pull = None
            return
        target = _vector(to)
        with self._news:
            held, name = self._pull, self._shown_feathers[feather].id
            if held is None or held[0].feather != name:
                held = self._nearest(feather, name, _vector(at)), target
            self._pull = held[0], target

    @property
    def _shown_feathers(self) -> list[Placement]:
        return some_of(self._made.shot, self._source.feathers)

    def _nearest(self, feather: int, name: str, at: Array) -> Grip:
        nodes = self._frame.poses[feather].points.nodes
        far = np.linalg.norm(nodes - at, axis=-1)
        row, node = np.unravel_index(int(far.argmin()), far.shape)
        columns, rows = (nodes.shape[1] - 1) // 2, nodes.shape[0]
        trailing = node > columns
        return Grip(
            feather=name,
            row=float(row) / (rows - 1),
            column=float(node - columns if trailing else node) / columns,
            side="trailing" if trailing else "leading",
            displacement=np.zeros(3),
            end=0.0,
            stiffness=_PULL,
        )

    def _make(self) -> Made:
        """The simulation with the presets as they are now."""
        source, changed = self._source, self._source.folder / "presets"
        with self._news:
            files = self.tuned.files()
        shutil.rmtree(changed, ignore_errors=True)
        changed.mkdir(parents=True)
        for name, text in files.items():
            path = changed / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text, encoding="utf-8")
        with self._aside if files else nullcontext():
            shot = read_shot(source.shot, (changed, *source.folders))
            quality = read_quality(source.quality, source.folders)
            # the same rows whatever the feather becomes, so that it goes on from where it is
            quality = quality.pushing
            quality = replace(quality, simulated_rows=max(quality.simulated_rows, 0))
            shot = replace(shot, quality=quality)
            placements = some_of(shot, source.feathers)
            if not 0 < len(placements) <= _MAX_FEATHERS:
                told = f"{len(placements)} feathers are not allowed. Give 1 to {_MAX_FEATHERS}"
                raise InputError(Problem(str(source.shot), "feather", told))
            ids = {each.id for each in placements}
            wanted = [k for k, each in enumerate(shot.groom.feathers) if each.id in ids]
            smooth = _SMOOTH if len(placements) <= _FEW else 0.0
            often = max(1, round(smooth / shot.frames_per_second))
            frames = shot.first_frame, shot.last_frame
            if shot.skin is None and shot.wind_source is None and not shot.colliders:
                frames = shot.first_frame, shot.first_frame + _ENDLESS
            simulation = LiveSimulation(shot, source.jobs, frames, often, wanted=wanted)
        surfaces = [each.surface for each in simulation.feathers]
        starts = np.cumsum([0, *(len(each.row) for each in surfaces)])
        rest = [
            place(each.rest, own.position, own.rotation)
            for each, own in zip(simulation.feathers, placements, strict=True)
        ]
        return Made(
            shot,
            simulation,
            often,
            JoinedSurfaces(simulation.feathers),
            np.concatenate([s.triangles + k for s, k in zip(surfaces, starts, strict=False)]),
            np.concatenate([s.points(r) for s, r in zip(surfaces, rest, strict=True)]),
            np.concatenate(
                [
                    s.barb_direction @ own.rotation.T
                    for s, own in zip(surfaces, placements, strict=True)
                ]
            ),
        )

    def _drawn(self, made: Made, frame: Frame) -> Played:
        """The meshes, as the page knows them: through a cache of one frame."""
        groom = replace(made.shot.groom, feathers=tuple(some_of(made.shot, self._source.feathers)))
        path = self._source.folder / "live.usdc"
        path.unlink(missing_ok=True)
        entries = entries_of(groom, made.simulation.feathers, static=False)
        with CacheWriter(path, entries, (1, 1), made.shot.frames_per_second) as writer:
            writer.write(replace(frame, number=1.0, poses=tuple(map(_at_rest, frame.poses))))
        played = Played(path, 1 << 62)
        # hooks are drawn by bakes alone
        played.values = [STRAIN]
        return played

    def _prepare(self) -> None:
        """Set up simulations for what was changed, while another goes on."""
        while True:
            with self._news:
                self._news.wait_for(lambda: self._wanted != self._prepared or self._ended)
                if self._ended:
                    return
                made_for = self._prepared = self._wanted
            try:
                made = self._make()
            except (InputError, SimulationError) as error:
                self._tell(str(error), made_for)
                continue
            with self._news:
                self._next, self._problem = (made, made_for), ""
                self._news.notify_all()

    def _tell(self, problem: str, generation: int) -> None:
        """Tell a problem, unless another change is on its way; it is that one's then to tell."""
        with self._news:
            if generation == self._wanted:
                self._problem = problem
                self._number += 1
                self._news.notify_all()

    def _step(self) -> None:
        """Go from frame to frame."""
        due = time.perf_counter()
        while True:
            with self._news:
                self._news.wait_for(self._may_go_on)
                if self._ended:
                    return
                made = None
                if self._next is not None:
                    made, self._generation = self._next
                    self._next, self._stuck = None, False
                generation = self._generation
            begun = time.perf_counter()
            try:
                self._advance(made, begun)
            except (InputError, SimulationError) as error:
                self._stuck = True
                self._tell(f"{error}; restart begins again", generation)
                continue
            except StopIteration:
                self._stuck = True
                self.restart()
                continue
            due += 1.0 / (self._rate * self._speed)
            left = due - time.perf_counter()
            if left > 0.0:
                time.sleep(left)
            else:
                due = time.perf_counter()

    @property
    def _rate(self) -> float:
        """Frames a second of the shot, those between whole frames included."""
        fps = self._made.shot.frames_per_second
        return fps * self._made.often

    def _may_go_on(self) -> bool:
        watched = time.monotonic() - self._asked < _PATIENCE
        return self._ended or self._next is not None or (watched and not self._stuck)

    def _advance(self, made: Made | None, begun: float) -> None:
        if made is not None:
            self._await_drawing()
            self._take(made)
        with self._news:
            wind, pull = self._made.shot.wind, self._pull
            if self._wind is not None:
                wind = replace(wind, direction=self._wind[0], speed=self._wind[1], gust=0.0)
        self._made.simulation.act(wind, [] if pull is None else [pull])
        draw = next(self._samples)
        figures = self._figures(time.perf_counter() - begun)
        self._await_drawing()
        self._drawing = self._drawer.submit(self._show, self._made, draw, figures)

    def _await_drawing(self) -> None:
        """Wait for the sample that is being drawn. Raises what drawing it raises, once."""
        drawing, self._drawing = self._drawing, None
        if drawing is not None:
            drawing.result()

    def _take(self, made: Made) -> None:
        """Go on with another simulation from where this one stands."""
        before, restarts = self._made, self._restarts
        again = restarts != self._restarted
        stays = np.array_equal(_roots(made.shot), _roots(before.shot))
        goes_on = not again and stays and made.simulation.reshaped(before.simulation)
        samples = made.simulation.live_samples()
        if not goes_on:
            self._frame = next(samples)()
        same = np.array_equal(made.triangles, before.triangles)
        played = self.played if same else self._drawn(made, self._frame)
        if not np.array_equal(made.points, before.points):
            rest: DrawnPose = played.rest
            played.rest = replace(rest, points=made.points, barbs=made.barbs)
        with self._news:
            self._made, self._samples, self.played = made, samples, played
            self._version += not same
            self._restarted = restarts

    def _figures(self, seconds: float) -> dict[str, Any]:
        """Figures of the sample that was simulated last. seconds: that it took."""
        counts, now = self._made.simulation.counted().summary(), time.perf_counter()
        if now - self._energy_at > _ENERGY_EVERY:
            self._energy, self._energy_at = self._made.simulation.energy()._asdict(), now
        return {
            "milliseconds": 1e3 * seconds,
            "energy": self._energy,
            "iterations": counts["newton_iterations"]["mean"],
            "substeps": counts["substeps"]["mean"],
        }

    def _show(self, made: Made, draw: Callable[[], Frame], figures: dict[str, Any]) -> None:
        """Draw a sample and hand it out."""
        self._frame = frame = draw()
        points = made.surfaces.points([each.points for each in frame.poses])
        where = {"version": self._version, "frame": frame.number, "time": frame.time}
        with self._news:
            self._number += 1
            self._told, self._points = where | figures, points
            self._news.notify_all()


class LiveServer(Server):
    """A server of a shot that is simulated. into: folder for presets that are saved."""

    def __init__(self, live: Live, into: Path, overwrite: bool, port: int = 0) -> None:
        super().__init__(port=port)
        self._live, self._into, self._overwrite = live, into, overwrite

    def content(self, name: str) -> tuple[str, bytes] | None:
        found = _LIVE.fullmatch(name)
        if found:
            return BYTES, self._live.after(int(found[2]), found[1].replace("points", ""))
        if name == "":
            return HTML, "".join(page(self._live.header(), self._live.name)).encode()
        if name == "header":
            return JSON, json.dumps(self._live.header()).encode()
        return (BYTES, self._live.played.constant()) if name == "constant" else None

    def posted(self, name: str, content: Any) -> Any:
        live = self._live
        if name == "change":
            live.change(content["key"], content["value"])
        elif name == "pull":
            live.pull(content.get("feather"), content.get("at"), content.get("to"))
        elif name == "blow":
            live.blow(content.get("direction"), content.get("speed", 0.0))
        elif name == "speed":
            live.play_at(content["speed"])
        elif name == "restart":
            live.restart()
        elif name == "save":
            written = live.tuned.write(self._into, self._overwrite)
            return {"written": [str(each) for each in written]}
        else:
            return None
        return {}


def some_of(shot: Shot, patterns: Sequence[str]) -> list[Placement]:
    """Feathers of a shot whose ids fit a pattern; all where there is none."""
    feathers = shot.groom.feathers
    return [f for f in feathers if not patterns or any(fnmatchcase(f.id, p) for p in patterns)]


def _at_rest(pose: FeatherPose) -> FeatherPose:
    """A pose without rates."""
    none = both(np.zeros_like, pose.points)
    return pose._replace(velocities=none, accelerations=none)


def _vector(values: Any) -> Array:
    """Three finite numbers. Raises ValueError for anything else."""
    found = np.array(values, dtype=float)
    if found.shape != (3,) or not np.isfinite(found).all():
        raise ValueError(values)
    return found


def presets_of(source: LiveSource) -> Tuned:
    """The presets that a shot names: of its feathers' kinds, of its wind and motion, and of wings
    and birds of its groom.

    A value that the shot or its groom says itself wins over presets, in what is shown as in a bake.
    """
    shot, library = read_shot(source.shot, source.folders), Library(source.folders, Problems())
    raw = load_toml(source.shot)
    groom = source.shot.parent / str(raw.get("groom", ""))
    made = load_toml(groom) if groom.suffix == ".toml" else {}
    kinds = dict.fromkeys(each.kind.name for each in some_of(shot, source.feathers))
    named = [("feather", name) for name in kinds]
    named += [
        (name, _base(raw.get(name, of))) for name, of in (("wind", "calm"), ("motion", "hold"))
    ]
    named += [("wing", _base(each.get("type"))) for each in made.get("wing", ())]
    named.append(("bird", _base(made.get("bird", {}).get("type"))))
    found = dict.fromkeys(each for each in named if library.find(*each))
    return Tuned(found, source.folders)


def _roots(shot: Shot) -> Array:
    """(N, 12) place and turn of each feather."""
    return np.array([[*each.position, *np.ravel(each.rotation)] for each in shot.groom.feathers])


def _base(given: Any) -> str:
    """Name of the preset that a value is, or begins with."""
    return str(given.get("base", "")) if isinstance(given, dict) else str(given or "")
