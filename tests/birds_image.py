"""The image of all birds, each on its own body: `python tests/birds_image.py -o FILE.png`."""

import subprocess
import sys
import tempfile
from pathlib import Path

from PIL import Image

ROOT = Path(__file__).resolve().parents[1]
BIRDS = "pigeon", "gull", "owl", "sparrow", "parrot", "peacock", "swan", "ostrich"
WIDTH, HEIGHT, COLUMNS = 600, 450, 2  # pixels of a bird
GROOM = """name = "{bird}"

[skin]
usd = "{bird}_body.usdc"
prim = "/pigeon/body"

[bird]
type = "{bird}"
bare = [{{ primvar = "beak" }}, {{ primvar = "eye" }}]

[bird.landmarks]
{landmarks}"""


def run(folder: Path, *command: str) -> str:
    """Run a program in a folder and return its output."""
    return subprocess.check_output([sys.executable, *command], cwd=folder, text=True)


def draw_bird(bird: str, folder: Path) -> Image.Image:
    """Return the image of one species."""
    body = f"{bird}_body.usdc"
    landmarks = run(folder, str(ROOT / "samples/pigeon/make_body.py"), body, bird)
    (folder / f"{bird}.toml").write_text(GROOM.format(bird=bird, landmarks=landmarks))
    featherfx, cache, image = ("-m", "featherfx"), f"{bird}.usdc", f"{bird}.png"
    run(folder, *featherfx, "groom", f"{bird}.toml", "-o", cache, "--quality", "final")
    size = f"{WIDTH}x{HEIGHT}"
    run(
        folder, *featherfx, "preview", cache, "-o", image, "--scenery", body, "--floor",
        "--size", size,
    )  # fmt: skip
    return Image.open(folder / image).convert("RGB")


def main(output: str) -> None:
    """Draw all birds into one image of 256 colours."""
    whole = Image.new("RGB", (COLUMNS * WIDTH, len(BIRDS) // COLUMNS * HEIGHT))
    with tempfile.TemporaryDirectory() as folder:
        for number, bird in enumerate(BIRDS):
            row, column = divmod(number, COLUMNS)
            whole.paste(draw_bird(bird, Path(folder)), (column * WIDTH, row * HEIGHT))
    whole.quantize(palette=whole.quantize(256)).save(output, optimize=True)  # dithers


if __name__ == "__main__":
    main(sys.argv[sys.argv.index("-o") + 1])
