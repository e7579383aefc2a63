"""A whole feather pulled at its tip and at its vane, with three materials of the vane."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from featherfx.lab.feathers.full_feather import (
    LEAST,
    LENGTH,
    MATERIALS,
    FullPull,
    Material,
    PulledFeather,
    pull_feather,
)
from featherfx.lab.studies.study import (
    Figure,
    Row,
    StudyResult,
    bounded,
    draw,
    ourselves,
    reported,
)

SHAPE = ourselves("a bound of ours that tells the behaviours apart; the published are pictures")


def side_pull(folder: Path) -> StudyResult:
    """The edge of the vane is pulled: barbs that do not stretch bend the rachis and wrinkle."""
    found = {name: pull_feather(FullPull("side", 0.1, material=name)) for name in MATERIALS}
    rows = _numbers(found)
    ours, others = found["barbs"], [found["cloth"], found["isotropic"]]
    softest = max(each.rachis_deflection for each in others)
    rows += [
        bounded(
            "rachis deflection, barbs over the larger of the others",
            ours.rachis_deflection / softest,
            SHAPE,
            at_least=1.25,
        ),
        bounded(
            "barb strain, barbs",
            ours.barb_strain,
            ourselves("barbs do not stretch by construction"),
            at_most=1e-3,
        ),
        bounded(
            "barb strain, the smaller of the others",
            min(each.barb_strain for each in others),
            SHAPE,
            at_least=0.1,
        ),
        bounded("wrinkle amplitude, barbs", ours.amplitude, SHAPE, at_least=LEAST, unit="m"),
        bounded(
            "wrinkle amplitude, the larger of the others",
            max(each.amplitude for each in others),
            SHAPE,
            at_most=LEAST,
            unit="m",
        ),
    ]
    nodal = pull_feather(FullPull("side", 0.1, nodal=True))
    rows += [
        reported(
            "rachis deflection / length, barbs in the nodal kinematics", nodal.rachis_deflection
        ),
        reported("wrinkle wavelength, the same", nodal.wavelength, unit="m"),
        reported("barb strain, the same", nodal.barb_strain),
    ]
    caption = (
        "The trailing edge pulled by a tenth of the feather's length, down the page; height above"
        " the plane in colour. Top to bottom: barbs, cloth, isotropic."
    )
    return StudyResult(rows, _picture(folder / "full_feather_side.png", caption, found))


def tip_pull(folder: Path) -> StudyResult:
    """The rachis' tip is pulled: all three bend; does the vane wrinkle on the inner side?"""
    found = {name: pull_feather(FullPull("tip", 0.2, material=name)) for name in MATERIALS}
    rows = _numbers(found)
    others = [found["cloth"], found["isotropic"]]
    rows += [
        bounded(
            "wrinkle amplitude, barbs",
            found["barbs"].amplitude,
            SHAPE,
            at_least=LEAST,
            unit="m",
        ),
        bounded(
            "wrinkle amplitude, the larger of the others",
            max(each.amplitude for each in others),
            SHAPE,
            at_most=LEAST,
            unit="m",
        ),
        reported(
            "wrinkle wavelength, barbs on 61 rows",
            pull_feather(FullPull("tip", 0.2, rows=61)).wavelength,
            unit="m",
            note="on 41 rows the wave is near four rows, the shortest that is looked for: its"
            " length is not converged there, that it wrinkles does not hang on it",
        ),
    ]
    caption = (
        "The rachis' tip pulled by a fifth of the feather's length. Top to bottom: barbs, cloth,"
        " isotropic."
    )
    return StudyResult(rows, _picture(folder / "full_feather_tip.png", caption, found))


def _numbers(found: Mapping[Material, PulledFeather]) -> list[Row]:
    rows = []
    for name, each in found.items():
        rows += [
            reported(f"rachis deflection / length, {name}", each.rachis_deflection),
            reported(f"barb strain, {name}", each.barb_strain),
            reported(f"force, {name}", each.force, unit="N"),
            reported(
                f"wrinkle wavelength, {name}",
                each.wavelength,
                unit="m",
                note="" if each.amplitude > LEAST else "no wrinkles",
            ),
            reported(f"wrinkle amplitude, {name}", each.amplitude, unit="m"),
        ]
    rows.append(
        reported(
            "seconds of the whole scenario, barbs",
            found["barbs"].seconds,
            unit="s",
            note="Jouve et al. 2024 name 5 minutes on another machine",
        )
    )
    return rows


def _picture(
    file: Path, caption: str, found: Mapping[Material, PulledFeather]
) -> tuple[Figure, ...]:
    def paint(canvas: Any) -> None:
        for k, (name, each) in enumerate(found.items()):
            axes = canvas.add_subplot(len(found), 1, k + 1)
            columns = (each.points.shape[1] - 1) // 2
            largest = 1e3 * max(float(np.abs(each.points[:, :, 2]).max()), LEAST)
            for side in range(2):
                order = [0, *range(1 + side * columns, 1 + (side + 1) * columns)]
                x, y, z = np.moveaxis(1e3 * each.points[:, order], -1, 0)
                drawn = axes.pcolormesh(
                    x, y, z, shading="gouraud", cmap="coolwarm", vmin=-largest, vmax=largest
                )
                axes.plot(x.T, y.T, color="k", lw=0.2)
            axes.plot(*(1e3 * each.points[:, 0, :2]).T, "k-", lw=1.5)
            axes.plot(*(1e3 * each.rest[:, 0, :2]).T, "k:", lw=0.8)
            axes.set_aspect("equal")
            axes.set_xlim(-5.0, 1e3 * LENGTH + 10.0)
            bottom, top = axes.get_ylim()
            axes.set_ylim(bottom - 3.0, top + 3.0)
            axes.set_ylabel("y, mm", fontsize=7)
            axes.set_title(name, fontsize=9)
            axes.tick_params(labelsize=6)
            canvas.colorbar(drawn, ax=axes, shrink=0.9, label="height, mm")
        axes.set_xlabel("x, mm", fontsize=7)

    return draw(file, caption, paint, (8.0, 7.0))
