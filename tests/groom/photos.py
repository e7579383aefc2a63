"""Pictures of known feathers, drawn flat on a pale ground, as photographs show them."""

from __future__ import annotations

import sys

import numpy as np
from PIL import Image, ImageDraw, ImageOps

from featherfx.feather.build import build_feather

GROUND, SHAFT, VANE = (235, 238, 240), (225, 215, 190), (120, 105, 95)
COLUMNS = 12


def picture(
    kind,
    angle=0.0,
    mirrored=False,
    textured=True,
    size=600,
    noise=0.0,
    dusk=0.0,
    shaft_colour=SHAFT,
):
    """An image, and (n, 2) pixels of its shaft. angle: rad, of the shaft's base, anticlockwise.
    dusk: by how much one corner is darker than the middle, of it, and the opposite one brighter."""
    feather = build_feather(kind, 81, COLUMNS)
    scale = size / feather.station[-1]
    c, s = np.cos(angle), np.sin(angle)
    turn = np.array([[c, -s], [s, c]]) * [[1.0], [-1.0]]

    def placed(points):
        flat = points[..., :2] * (scale * np.array([1.0, -1.0 if mirrored else 1.0]))
        return flat @ turn.T

    points = placed(feather.surface.points(feather.rest))
    low = points.min(axis=0) - 40.0
    wide, high = np.ceil(points.max(axis=0) - low + 40.0).astype(int).tolist()
    image = Image.new("RGB", (wide, high), GROUND)
    draw = ImageDraw.Draw(image)
    for corners in (points - low)[feather.surface.triangles]:
        draw.polygon([tuple(each) for each in corners.tolist()], fill=VANE, outline=VANE)
    rng = np.random.default_rng(1)
    fine = build_feather(kind, 241, COLUMNS)
    nodes = placed(fine.rest.nodes) - low
    for side in range(2 if textured else 0):
        own = slice(1 + side * COLUMNS, 1 + (side + 1) * COLUMNS)
        for row in np.flatnonzero(fine.barb_length[side] > 0.0):
            grey = int(rng.integers(70, 150))
            barb = np.concatenate([nodes[row, :1], nodes[row, own]])
            draw.line([tuple(each) for each in barb.tolist()], fill=(grey, grey - 10, grey - 20))
    shaft = nodes[:, 0]
    width = np.maximum(fine.width * scale, 2.0).round().astype(int).tolist()
    for k in range(len(shaft) - 1):
        ends = [tuple(each) for each in shaft[k : k + 2].tolist()]
        draw.line(ends, fill=shaft_colour if textured else VANE, width=width[k])
    if noise or dusk:
        pixels = np.asarray(image, dtype=np.float64)
        rows, columns = (np.linspace(-0.5, 0.5, size) for size in pixels.shape[:2])
        pixels = pixels * (1.0 + dusk * (rows[:, None] + columns))[..., None]
        pixels = pixels + rng.normal(scale=noise, size=pixels.shape)
        image = Image.fromarray(np.clip(pixels, 0, 255).astype(np.uint8))
    return image, shaft


def vignetted(image, share, margin=100):
    """With more ground around it, and corners darker by a share, as the fourth power of the way
    there from the middle."""
    pixels = np.asarray(ImageOps.expand(image, margin, GROUND), dtype=np.float64)
    rows, columns = (np.linspace(-0.5, 0.5, size) for size in pixels.shape[:2])
    way = 2.0 * (rows[:, None] ** 2 + columns**2)
    return Image.fromarray((pixels * (1.0 - share * way**2)[..., None]).astype(np.uint8))


if __name__ == "__main__":
    from featherfx.trace.trace import flattened, kind_of_text

    image, _ = picture(flattened(kind_of_text('base = "swan_primary"\n')), 0.1, noise=3.0)
    image.save(sys.argv[sys.argv.index("-o") + 1])
