"""Pictures of the vane experiments, as PNG; none without matplotlib (extra `plots`)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from featherfx.algebra.types import Array
from featherfx.lab.studies.study import Figure, draw
from featherfx.lab.vane.mesoscale import AngleSlopes, ShearBand, SizeEffect
from featherfx.lab.vane.traction import Locking, Meshing, PulledSample

_MARKS: tuple[tuple[Meshing, str], ...] = (("aligned", "o-"), ("unaligned", "s--"))


def locking_picture(file: Path, study: Locking) -> tuple[Figure, ...]:
    """Error against the number of elements, for all ratios."""

    def paint(canvas: Any) -> None:
        axes = canvas.subplots()
        ratios = sorted({p.ratio for p in study.points if math.isfinite(p.ratio)})
        for number, ratio in enumerate(ratios):
            for mesh, line in _MARKS:
                points = np.array(study.error(mesh, ratio), dtype=float)
                label = f"{mesh}, ratio {ratio:g}"
                axes.loglog(points[:, 0], points[:, 1], line, color=f"C{number}", label=label)
        limit = np.array(study.error("aligned", math.inf))
        axes.loglog(limit[:, 0], limit[:, 1], "k^:", label="aligned, inextensible")
        axes.set(xlabel="elements", ylabel="relative error of the stress")
        axes.legend(fontsize=7)

    caption = (
        "Error of the tilted test at 5 % strain against the number of elements. Unaligned meshes"
        " lock the more, the stiffer the barbs; aligned ones do not."
    )
    return draw(file, caption, paint)


def size_picture(file: Path, study: SizeEffect) -> tuple[Figure, ...]:
    """Stress in compression along the barbs: against strain, and against the barbs' width."""

    def paint(canvas: Any) -> None:
        left, right = canvas.subplots(1, 2)
        for count, stresses in zip(study.counts, study.stress_over_barb_modulus, strict=True):
            left.plot([0, *study.strain], [0, *stresses], "o-", label=f"N = {count}")
        left.set(xlabel="strain", ylabel="stress / modulus of the barbs")
        left.legend()
        width = np.linspace(0.0, 1.0 / min(study.counts), 50)
        right.plot(width, study.constant + study.quadratic * width**2, "--", label="quadratic fit")
        last = study.stress_over_barb_modulus[:, -1]
        right.plot(1.0 / np.array(study.counts), last, "o", label="tests")
        right.set(xlabel="width of the barbs, 1 / N", ylabel="stress at the largest strain")
        right.legend()

    caption = "Compression along the barbs: the stress grows with the square of their width."
    return draw(file, caption, paint, (9.0, 4.0))


def angles_picture(file: Path, study: AngleSlopes, barbule: float) -> tuple[Figure, ...]:
    """Slopes of both models against the angle, over the barbules' modulus (Pa)."""

    def paint(canvas: Any) -> None:
        axes = canvas.subplots()
        axes.plot(study.angles, study.bands / barbule, "o-", label="mesoscale (bands)")
        axes.plot(study.angles, study.membrane / barbule, "s--", label="macroscale (membrane)")
        axes.set(xlabel="barb angle, degrees", ylabel="slope / modulus of the barbules")
        axes.legend()

    return draw(file, "Slopes of traction tests at all angles in both models.", paint)


def band_picture(file: Path, bands: Sequence[ShearBand]) -> tuple[Figure, ...]:
    """Pulled samples of all aspect ratios: mesoscale above, macroscale below."""

    def paint(canvas: Any) -> None:
        grid = canvas.subplots(2, len(bands), squeeze=False)
        for column, band in enumerate(bands):
            most = float(np.quantile(_shear(band.bands), 0.98))
            for axes, pulled, name in (
                (grid[0, column], band.bands, "mesoscale"),
                (grid[1, column], band.membrane, "macroscale"),
            ):
                drawn = _deformed(axes, pulled, most)
                axes.set_title(f"{name}, aspect {band.aspect:g}", fontsize=8)
            below = grid[:, column].tolist()
            canvas.colorbar(drawn, ax=below, location="bottom", shrink=0.8, label="2 |e_vw|")

    caption = (
        "Tilted tests in both models, coloured by the size of the shear 2 e_vw, on one scale for"
        " each aspect ratio: the shear band between what the two clamps hold widens with it."
    )
    return draw(file, caption, paint, (2.6 * len(bands), 7.0))


def _shear(pulled: PulledSample) -> Array:
    """(M,) size of 2 e_vw in each element."""
    strain = pulled.statics.system.strains(pulled.pose.positions)
    mean: Array = np.abs(strain[..., 2]).mean(axis=1)
    return mean


def _deformed(axes: Any, pulled: PulledSample, most: float) -> Any:
    drawn = axes.tripcolor(
        *pulled.pose.positions.T,
        pulled.statics.membrane.nodes[:, :3],
        facecolors=_shear(pulled),
        cmap="viridis",
        vmin=0.0,
        vmax=most,
    )
    axes.set_aspect("equal")
    axes.set_axis_off()
    return drawn
