"""Draws docs/images/barb_grid.png: python docs/images/barb_grid.py (needs matplotlib)."""

from __future__ import annotations

from io import BytesIO
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.collections import LineCollection, PolyCollection
from PIL import Image

from featherfx.feather.build import build_feather
from featherfx.feather.types import LEADING, RACHIS_PART, TRAILING, Feather
from featherfx.groom.materials import RachisMaterial, VaneMaterial
from featherfx.groom.types import BarbGuide, FeatherKind, RachisShape, VaneShape

COLOURS = {LEADING: "#1f6fb4", TRAILING: "#c4502c", RACHIS_PART: "#3c3a36"}
KIND = FeatherKind(
    name="swan primary",
    length=0.35,
    calamus=0.15,
    barb_spacing=5e-4,
    rachis=RachisShape(0.006, 0.0008, 1.0, 8.0, 12.0, 0.0),
    leading=VaneShape(
        ((0, 0), (0.08, 0.022), (0.3, 0.035), (0.7, 0.036), (0.93, 0.022), (1.01, 0)),
        (BarbGuide(0, 35, 5, 3), BarbGuide(0.5, 28, 8, 3), BarbGuide(1, 22, 6, 2)),
    ),
    trailing=VaneShape(
        ((0, 0), (0.03, 0.05), (0.15, 0.1), (0.45, 0.12), (0.75, 0.1), (0.94, 0.05), (1.01, 0)),
        (BarbGuide(0, 65, 25, 8), BarbGuide(0.4, 48, 18, 8), BarbGuide(1, 25, 8, 3)),
    ),
    vane_material=VaneMaterial(3.6e8, 4.8e4, 2.8e4, 1.2e-4, 0.05, 2.5e-4, 2.5e-3, 1, 1e-6, 0.1),
    rachis_material=RachisMaterial(5e9, 1.5e9, 0.2, 0.9, 1300, 100, 0.05),
)


def draw_feather(axes: plt.Axes, feather: Feather, nodes: bool) -> None:
    """Triangles pale, barbs strong, seen from dorsal; centimetres."""
    surface = feather.surface
    points = 100.0 * surface.points(feather.points)[:, :2]
    for part, colour in COLOURS.items():
        corners = points[surface.triangles[surface.part == part]]
        pale = PolyCollection(
            list(corners), facecolors=colour, edgecolors=colour, lw=0.4, alpha=0.22
        )
        axes.add_collection(pale)
    m = feather.columns
    for side in (LEADING, TRAILING):
        columns = [0, *range(3 + side * m, 3 + (side + 1) * m)]
        barbs = 100.0 * feather.points[feather.barb_length[side] > 0.0][:, columns, :2]
        axes.add_collection(LineCollection(list(barbs), colors=COLOURS[side], lw=1.4))
        if nodes:
            axes.plot(*barbs.reshape(-1, 2).T, "o", color=COLOURS[side], ms=3.5)
    rachis = 100.0 * feather.points[:, 0, :2]
    axes.plot(*rachis.T, color=COLOURS[RACHIS_PART], lw=2.0, marker="o" if nodes else "", ms=5)
    axes.set_aspect("equal")
    axes.axis("off")


def point(axes: plt.Axes, text: str, target: np.ndarray, offset: tuple[float, float]) -> None:
    axes.annotate(
        text,
        target[:2],
        offset,
        textcoords="offset points",
        ha="center",
        fontsize=9,
        arrowprops={"arrowstyle": "-", "lw": 0.6},
    )


def main() -> None:
    feather = build_feather(KIND, 21, 6)
    r = 100.0 * feather.points
    figure, (top, zoom) = plt.subplots(2, 1, figsize=(10, 7.6), height_ratios=(1, 1.25))
    draw_feather(top, feather, False)
    point(top, "follicle, row 0", r[0, 0], (10, -34))
    point(top, "calamus", 0.5 * (r[1, 0] + r[2, 0]), (-6, 30))
    point(top, "first row of the vane", r[3, 0], (30, 46))
    point(top, "rachis", r[10, 0], (40, 62))
    point(top, "leading vane", r[12, 3 + 4], (60, 32))
    point(top, "trailing vane", r[9, 9 + 4], (-70, -40))
    point(top, "tip, row n - 1", r[20, 0], (-5, 40))

    draw_feather(zoom, feather, True)
    i = 10
    for column, side in ((1, TRAILING), (2, LEADING)):
        lower = np.array([r[i, 2 + 6 * side + j] for j in (column, column + 1)])
        upper = np.array([r[i + 1, 2 + 6 * side + j] for j in (column, column + 1)])
        for name, corners in (
            ("A", (lower[0], lower[1], upper[0])),
            ("B", (lower[1], upper[1], upper[0])),
        ):
            flat = np.array(corners)[:, :2]
            zoom.add_patch(plt.Polygon(flat, color=COLOURS[side], alpha=0.45, lw=0))
            zoom.text(*flat.mean(axis=0), name, ha="center", va="center", fontsize=10)
    point(zoom, "row i", r[i, 0], (-46, 34))
    point(zoom, "row i + 1", r[i + 1, 0], (-30, 62))
    point(zoom, "barb node j = 1", r[i, 9], (-78, -18))
    point(zoom, "j = 2", r[i, 10], (-52, -18))
    point(zoom, "j = m", r[i, 14], (-40, -8))
    zoom.set_xlim(15.0, 27.0)
    zoom.set_ylim(-6.2, 1.2)
    zoom.set_title("two cells of the grid: each triangle has one edge along a barb", fontsize=10)
    figure.tight_layout()
    buffer = BytesIO()
    figure.savefig(buffer, dpi=110)
    # A palette of 128 colours halves the file.
    picture = Image.open(buffer).convert("RGB").quantize(128)
    picture.save(Path(__file__).with_name("barb_grid.png"), optimize=True)


if __name__ == "__main__":
    main()
