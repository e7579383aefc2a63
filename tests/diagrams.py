"""Diagrams of the pages: `python tests/diagrams.py landmarks|row|notebook -o FILE.png`.

They need the extra "plots"."""

import json
import os
import sys
import tomllib
from pathlib import Path

import matplotlib as mpl

mpl.use("Agg")
import itertools

import matplotlib.pyplot as plt
import numpy as np
from pxr import Usd, UsdGeom

import featherfx

ROOT = Path(__file__).resolve().parents[1]
GREY, BLUE, RED = "#c8ccd2", "#1f6fb4", "#c8502d"


def draw_landmarks(axes: plt.Axes) -> None:
    """Draw the body of `samples/first_bird` from its right side, with its landmarks."""
    folder = ROOT / "samples/first_bird"
    groom = tomllib.loads((folder / "groom.toml").read_text(encoding="utf-8"))
    stage = Usd.Stage.Open(str(folder / groom["skin"]["usd"]))
    mesh = UsdGeom.Mesh(stage.GetPrimAtPath(groom["skin"]["prim"]))
    points = np.array(mesh.GetPointsAttr().Get(Usd.TimeCode.Default()))
    corners = np.array(mesh.GetFaceVertexIndicesAttr().Get())
    starts = np.cumsum([0, *mesh.GetFaceVertexCountsAttr().Get()])
    for first, end in itertools.pairwise(starts):
        axes.fill(*points[corners[first:end]][:, [0, 2]].T, color=GREY, lw=0.2)
    for name, place in groom["bird"]["landmarks"].items():
        if not name.startswith("left_"):
            axes.plot(place[0], place[2], "o", color=RED, ms=5)
            axes.annotate(name, (place[0], place[2]), (6, 6), textcoords="offset points")
    axes.set(xlabel="x, forward (m)", ylabel="z, up (m)")


def draw_row(axes: plt.Axes) -> None:
    """Draw the roots, lengths and directions of the primaries of `samples/swan_wing` from above."""
    groom = featherfx.read_groom(ROOT / "samples/swan_wing/groom.toml")
    row = [each for each in groom.feathers if each.id.startswith("right_primary")]
    for number, each in enumerate(row):
        root, along = np.array(each.position), np.array(each.rotation)[:, 0] * each.kind.length
        ends = np.array([root, root + along])
        colour = RED if number in (0, len(row) - 1) else BLUE
        axes.plot(ends[:, 1], ends[:, 0], color=colour, lw=2)
        axes.plot(root[1], root[0], "o", color=colour, ms=6)
    for each, text in ((row[0], "first"), (row[-1], "last")):
        axes.annotate(text, each.position[1::-1], (8, 8), textcoords="offset points", color=RED)
    axes.annotate("direction", ends[-1, 1::-1], (-30, -14), textcoords="offset points", color=RED)
    axes.invert_xaxis()
    axes.set(xlabel="y, to the left (m)", ylabel="x, forward (m)")


def run_notebook() -> plt.Figure:
    """Return what docs/notebook.ipynb draws; it reads the sample `feather_pull`."""
    cells = json.loads((ROOT / "docs/notebook.ipynb").read_text(encoding="utf-8"))["cells"]
    os.chdir(ROOT / "samples")
    known: dict[str, object] = {}
    for cell in cells:
        if cell["cell_type"] == "code":
            exec("".join(cell["source"]), known)
    return plt.gcf()


def main(name: str, output: str) -> None:
    """Draw a diagram into a file."""
    path = Path(output).absolute()
    if name == "notebook":
        run_notebook().savefig(path, dpi=90, metadata={"Software": None})
        return
    figure, axes = plt.subplots(figsize=(7, 5), dpi=110)
    {"landmarks": draw_landmarks, "row": draw_row}[name](axes)
    axes.set_aspect("equal")
    figure.tight_layout()
    figure.savefig(path, metadata={"Software": None})


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[sys.argv.index("-o") + 1])
