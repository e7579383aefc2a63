"""A gate for promised errors: random shots from one fixed distribution, beside a reference.

Every feather of every shot is a case. The reference has twice the rows, columns and coefficients of
what the bake simulates, and a tenth of its tolerance; where it is not kept, that is checked on
three times the rows, columns and coefficients. A case is

    kept        no node is farther from the reference than promised, at any frame
    undefined   the reference and its check are farther from each other than that
    broken      all others

told counts the undefined cases that the bake named.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np

from featherfx.errors import InputError
from featherfx.feather.build import build_feather
from featherfx.feather.density import max_distance
from featherfx.feather.types import Feather, RowPoints
from featherfx.groom.keys.preset import Quality
from featherfx.groom.presets.presets import list_presets, load_preset
from featherfx.groom.types import FeatherKind
from featherfx.shot.loop.contact_error import measure_contact_error
from featherfx.shot.loop.simulate import simulate
from featherfx.shot.options.options import MAX_COEFFICIENTS, FeatherOptions
from featherfx.shot.patterns import part_of
from featherfx.shot.read.read import read_shot
from featherfx.shot.types import Shot

# of the distribution: errors (percent), fastest wind (m/s); feathers and frames of a free shot
_ERRORS, _MAX_WIND, _FEATHERS, _FRAMES = (3.0, 1.5, 0.5), 20.0, 3, 13
# of a shot with contact: distance of its feathers, of their length; their number, and frames
_CLOSE, _TOUCHING, _TOUCHING_FRAMES = 0.06, 2, 5
# finer by, and the check; tolerances tighter by
_FINER, _CHECK, _TIGHTER = 2, 3, 10.0


class FineRun(NamedTuple):
    """Feathers by number as they were simulated, and their points at every frame.

    options: of every feather.
    """

    feathers: dict[int, Feather]
    points: dict[int, list[RowPoints]]
    report: dict[str, Any]
    options: Sequence[FeatherOptions]


@dataclass(frozen=True)
class PromiseCase:
    """promised, reached: percent of the length; checked: of the reference by its own check."""

    seed: int
    feather: str
    contact: bool
    promised: float
    reached: float
    checked: float
    outcome: str
    told: bool


def run(shot: Shot) -> FineRun:
    """Simulate a shot on one thread."""
    simulation = simulate(shot)
    feathers: dict[int, Feather] = {}
    points: dict[int, list[RowPoints]] = {}
    for _ in simulation:
        for f, (feather, now) in sorted(simulation.simulated().items()):
            feathers[f] = feather
            points.setdefault(f, []).append(RowPoints(now.nodes.copy(), now.directors.copy()))
    return FineRun(feathers, points, simulation.report, simulation.options)


def errors(one: FineRun, reference: FineRun) -> list[float]:
    """Per feather the largest distance of any point that one run simulates, at any frame, from
    where the reference has it, over the feather's length."""
    return [
        max_distance(own, reference.feathers[f], one.points[f], reference.points[f])
        / float(own.station[-1])
        for f, own in one.feathers.items()
    ]


def fixed_quality(
    grid: tuple[int, int, int], tolerance: float, rest: Quality, length: float = 1.0
) -> Quality:
    """Return a quality that simulates all feathers alike.

    grid: rows, columns, coefficients. tolerance: over the length, of each; where they push each
    other, of all by the length given (m).
    """
    rows, columns, coefficients = grid
    return Quality(
        name="fixed",
        rows=min(rows, 400),
        columns=min(columns, 100),
        coefficients=min(coefficients, MAX_COEFFICIENTS),
        tolerance=tolerance * length,
        relative_tolerance=max(tolerance, 1e-6),
        max_substeps=rest.max_substeps,
        spectral_radius=rest.spectral_radius,
    )


def measure_promise(seed: int, kinds: Sequence[str]) -> list[PromiseCase]:
    """Measure whether a random shot keeps its promise, feather by feather."""
    shot = random_shot(seed, kinds)
    promised = shot.quality.promised
    assert promised is not None
    found = run(shot)
    reached = np.array(_beside(shot, found, _FINER, found))
    checked, cases = np.zeros(len(reached)), []
    if (reached > promised).any():
        checked = np.array(_beside(shot, found, _CHECK, found, _FINER))
    report = found.report | measure_contact_error(shot)
    named = {each for names in report.get("undefined", {}).values() for each in names}
    for k, placement in enumerate(shot.groom.feathers):
        outcome = "kept" if reached[k] <= promised else "broken"
        if outcome == "broken" and checked[k] > promised:
            outcome = "undefined"
        cases.append(
            PromiseCase(
                seed=seed,
                feather=f"{placement.id} ({placement.kind.name})",
                contact=shot.contact is not None,
                promised=100.0 * promised,
                reached=100.0 * float(reached[k]),
                checked=100.0 * float(checked[k]),
                outcome=outcome,
                told=placement.id in named,
            )
        )
    return cases


def _beside(shot: Shot, found: FineRun, finer: int, one: FineRun, against: int = 1) -> list[float]:
    """Errors of a run, or of a reference that is finer by `against`, beside one that is finer."""
    if shot.contact is not None:
        every = np.arange(len(shot.groom.feathers))
        wanted = run(_finer(shot, found, finer, every))
        own = one if against == 1 else run(_finer(shot, found, against, every))
        return errors(own, wanted)
    worst = []
    for f in range(len(shot.groom.feathers)):
        each = np.array([f])
        wanted = run(_finer(shot, found, finer, each))
        own = FineRun({0: one.feathers[f]}, {0: one.points[f]}, {}, ())
        if against != 1:
            own = run(_finer(shot, found, against, each))
        worst += errors(own, wanted)
    return worst


def _finer(shot: Shot, found: FineRun, finer: int, some: np.ndarray) -> Shot:
    """The shot with some of its feathers, finer than the bake simulated any of them."""
    options = [found.options[f] for f in some]
    lengths = [shot.groom.feathers[f].kind.length for f in some]
    rows = finer * (max(each.rows for each in options) - 1) + 1
    columns = finer * max(each.columns for each in options)
    rows = min(_finest_rows(shot.groom.feathers[f].kind, rows, columns) for f in some)
    grid = rows, columns, finer * max(each.coefficients for each in options)
    tolerance = min(each.tolerance / size for each, size in zip(options, lengths, strict=True))
    length = min(lengths) if shot.contact is not None else max(lengths)
    quality = fixed_quality(grid, tolerance / _TIGHTER, shot.quality, length)
    return replace(part_of(shot, some), quality=quality)


def _finest_rows(kind: FeatherKind, rows: int, columns: int) -> int:
    """Return so many rows, or the most on which the vane of a kind does not fold over itself."""
    while True:
        try:
            build_feather(kind, min(rows, 400), min(columns, 100))
        except InputError:
            rows -= max(rows // 20, 1)
        else:
            return rows


def measure_promises(count: int, seed: int, progress: Callable[[int, int], None]) -> dict[str, Any]:
    """Measure so many random shots from a seed on: kept, broken, undefined, told, and cases."""
    kinds = sorted(each.path.stem for each in list_presets() if each.family == "feather")
    cases: list[PromiseCase] = []
    for number in range(count):
        cases += measure_promise(seed + number, kinds)
        progress(number + 1, count)
    counts = {
        outcome: sum(each.outcome == outcome for each in cases)
        for outcome in ("kept", "broken", "undefined")
    }
    told = sum(each.told for each in cases if each.outcome == "undefined")
    return {**counts, "told": told, "cases": [asdict(each) for each in cases]}


def random_shot(seed: int, kinds: Sequence[str]) -> Shot:
    """Draw a shot: kinds in turn, winds with gusts, shakes and flaps, a third with contact."""
    random = np.random.default_rng(seed)
    contact = seed % 3 == 2
    names = [kinds[(seed * _FEATHERS + k) % len(kinds)] for k in range(_FEATHERS)]
    if contact:
        names = [kinds[seed // 3 % len(kinds)]] * _TOUCHING
    length = max(load_preset(f"feather/{name}")[1]["length"].value for name in names)
    groom = 'name = "random"\n'
    way, up = random.normal(size=(2, 3))
    over = np.cross(np.cross(way, up), way)
    for k, name in enumerate(names):
        place = (1.0 + 3.0 * length) * np.array([0.0, 0.0, k])
        if contact:
            place = _CLOSE * length * k * over / np.linalg.norm(over)
        else:
            way, up = random.normal(size=(2, 3))
        groom += (
            f'[[feather]]\nid = "f{k}"\nkind = "{name}"\nposition = {_list(place)}\n'
            f"direction = {_list(way)}\nup = {_list(up)}\nscale = {random.uniform(0.7, 1.4):.3f}\n"
        )
    speed = _MAX_WIND * random.uniform() ** 2
    wind = (
        f"[wind]\nspeed = {speed:.3f}\ngust = {random.uniform(0.0, 0.5):.3f}\n"
        f"direction = {_list(random.normal(size=3))}\nseed = {seed}\n"
    )
    motion = [
        "motion = 'hold'\n",
        f"motion = {{ kind = 'shake', amplitude = {random.uniform(0.0, 0.05):.4f}, frequency ="
        f" {random.uniform(0.5, 4.0):.3f}, direction = {_list(random.normal(size=3))} }}\n",
        f"motion = {{ kind = 'swing', axis = {_list(random.normal(size=3))}, angle ="
        f" {random.uniform(5.0, 40.0):.2f}, frequency = {random.uniform(0.5, 3.0):.3f} }}\n",
    ][seed // 3 % 3]
    error = _ERRORS[seed // 9 % 3]
    shot = (
        f'name = "random"\ngroom = "groom.toml"\n{motion}'
        f"frames = [1, {_TOUCHING_FRAMES if contact else _FRAMES}]\n"
        f"quality = {{ error = {error} }}\n{wind}" + ("[contact]\n" if contact else "")
    )
    with TemporaryDirectory() as folder:
        Path(folder, "groom.toml").write_text(groom, encoding="utf-8")
        Path(folder, "shot.toml").write_text(shot, encoding="utf-8")
        return read_shot(Path(folder, "shot.toml"))


def _list(values: Any) -> str:
    return "[" + ", ".join(f"{float(each):.5f}" for each in values) + "]"
