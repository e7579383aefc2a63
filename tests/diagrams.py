"""Diagrams of the pages: `python tests/diagrams.py NAME -o FILE.png`, NAME of DIAGRAMS, or keys,
notebook or textures.

They need the extra "plots"."""

import json
import os
import subprocess
import sys
import tempfile
import tomllib
from pathlib import Path

import matplotlib as mpl

mpl.use("Agg")
import itertools

import matplotlib.pyplot as plt
import numpy as np
from PIL import Image
from pxr import Usd, UsdGeom

import featherfx
from featherfx.feather.build import build_feather
from featherfx.feather.types import Feather
from featherfx.trace.trace import kind_of_text

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


# keys of a feather preset, three values of each, and the axes of the view
KEYS = (
    ("calamus", (0.05, 0.15, 0.4), (0, 1)),
    ("rachis.sweep", (-12, 12, 35), (0, 1)),
    ("rachis.camber", (0, 10, 45), (0, 2)),
    ("rachis.twist", (-4, 30, 60), (0, 1)),
    ("trailing.outline", (0.5, 1, 1.6), (0, 1)),
    ("trailing.rounded_base", (0, 0.15, 0.5), (0, 1)),
    ("trailing.guides.angle", (34, 45, 65), (0, 1)),
    ("trailing.guides.curl", (-25, 0, 20), (0, 1)),
)


def build_swan(extra: str = "", rows: int = 61) -> Feather:
    """Build a swan primary with other keys of its preset."""
    return build_feather(kind_of_text(f'base = "swan_primary"\n{extra}'), rows, 8)


def draw_barbs(axes: plt.Axes, feather: Feather, view: tuple[int, int] = (0, 1)) -> None:
    """Draw rachis and barbs of a feather at rest. view: the axes to the right and up."""
    nodes = feather.rest.nodes[..., view]
    for side, colour in ((0, BLUE), (1, RED)):
        for row in np.flatnonzero(feather.barb_length[side] > 0.0):
            barb = np.concatenate([nodes[row, :1], nodes[row, 1 + 8 * side : 9 + 8 * side]])
            axes.plot(*barb.T, color=colour, lw=0.7)
    axes.plot(*nodes[:, 0].T, color="#333333", lw=2)


def draw_feather(axes: plt.Axes) -> None:
    """Draw a feather of the right wing from above, with the names of its parts and its axes."""
    feather = build_swan()
    draw_barbs(axes, feather)
    nodes, first = feather.rest.nodes[..., :2], np.argmax(feather.barb_length[0] > 0.0)
    marks = {
        "follicle": (nodes[0, 0], (-4, -28)),
        "calamus": (nodes[first // 2, 0], (-10, 24)),
        "rachis": (nodes[34, 0], (-4, 62)),
        "leading vane": (nodes[44, 8], (0, 34)),
        "trailing vane": (nodes[36, 14], (-20, -50)),
        "barb": (nodes[46, 13], (16, -62)),
        "tip": (nodes[-1, 0], (-4, 24)),
    }
    for name, (place, offset) in marks.items():
        axes.annotate(
            name, place, offset, textcoords="offset points", arrowprops={"arrowstyle": "-"}
        )
    ends = {"x, along the rachis": (0.05, 0.0), "y, to the leading vane": (0.0, 0.05)}
    for name, end in ends.items():
        axes.annotate("", end, (0, 0), arrowprops={"arrowstyle": "->", "color": "#2b8a3e", "lw": 2})
        offset = (4, 4) if end[1] else (-40, -44)
        axes.annotate(name, end, offset, textcoords="offset points", color="#2b8a3e")
    axes.set(xlabel="m; z, dorsal, points to the viewer", ylim=(-0.1, 0.07))


def draw_grid(axes: plt.Axes) -> None:
    """Draw cells of a coarse barb grid: nodes, and both triangles of two cells."""
    feather = build_swan(rows=17)
    nodes = feather.rest.nodes[..., :2]
    points = feather.surface.points(feather.rest)[:, :2]
    axes.triplot(*points.T, feather.surface.triangles, color=GREY, lw=0.6)
    draw_barbs(axes, feather)
    axes.plot(*nodes[:, 1:].reshape(-1, 2).T, ".", color="#333333", ms=4)
    cells = np.array([nodes[8, 10], nodes[8, 11], nodes[9, 11], nodes[9, 10]])
    for corners, name in (((0, 1, 3), "A"), ((1, 2, 3), "B")):
        axes.fill(*cells[list(corners)].T, color=RED, alpha=0.4)
        axes.annotate(name, cells[list(corners)].mean(axis=0), ha="center", va="center")
    for row, name in ((8, "row i"), (9, "row i + 1")):
        axes.annotate(name, nodes[row, 0], (-16, 30), textcoords="offset points",
                      arrowprops={"arrowstyle": "-"})  # fmt: skip
    for column in (1, 2, 8):
        axes.annotate(f"j = {'m' if column == 8 else column}", nodes[8, 8 + column], (-44, -4),
                      textcoords="offset points")  # fmt: skip
    axes.set(xlim=(0.13, 0.27), ylim=(-0.06, 0.02))


def draw_keys(figure: plt.Figure) -> None:
    """Draw a strip of feathers for each of some keys of a preset."""
    figure.set_size_inches(9, 1.5 * len(KEYS))
    panels = figure.subplots(len(KEYS), 3)
    figure.subplots_adjust(0.01, 0.0, 0.99, 0.97, wspace=0.02, hspace=0.2)
    outline = kind_of_text('base = "swan_primary"\n').trailing.outline
    for strip, (key, values, view) in zip(panels, KEYS, strict=True):
        side, _, last = key.rpartition(".")
        for axes, value in zip(strip, values, strict=True):
            written = f"{key} = {value}"
            if last == "outline":
                written = f"{key} = {[[x, value * y] for x, y in outline]}"
            elif side.endswith("guides"):
                given = {"angle": 45, "curl": 0, last: value}
                guide = ", ".join(f"{name} = {each}" for name, each in given.items())
                written = f"{side} = [{{ position = 0, {guide} }}, {{ position = 1, {guide} }}]"
            draw_barbs(axes, build_swan(written), view)
            axes.set_title(f"{key} {value}" + " times as wide" * (last == "outline"), size=8)
            axes.set(aspect="equal", xlim=(-0.01, 0.36), ylim=(-0.135, 0.045))
            axes.axis("off")


DIAGRAMS = {
    "landmarks": draw_landmarks,
    "row": draw_row,
    "feather": draw_feather,
    "grid": draw_grid,
}


def draw_textures(path: Path) -> None:
    """Draw the charts of the feathers of docs/images/patterns.toml, as --textures writes them."""
    groom, height = ROOT / "docs/images/patterns.toml", 384
    with tempfile.TemporaryDirectory() as folder:
        options = ["-o", f"{folder}/patterns.usdc", "--textures", str(height)]
        command = [sys.executable, "-m", "featherfx", "groom", str(groom), *options]
        subprocess.run(command, cwd=ROOT, check=True, stderr=subprocess.DEVNULL)
        tile = Image.open(f"{folder}/patterns.colour.1001.png")
        tile.crop((0, tile.height - height, 2 * height, tile.height)).save(path)


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
    if name == "textures":
        draw_textures(path)
        return
    figure = plt.figure(figsize=(7, 3.6 if name in ("feather", "grid") else 5), dpi=110)
    if name == "keys":
        draw_keys(figure)
    else:
        axes = figure.subplots()
        DIAGRAMS[name](axes)
        axes.set_aspect("equal")
    figure.tight_layout()
    figure.savefig(path, metadata={"Software": None})


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[sys.argv.index("-o") + 1])
