"""A flock of small birds: wings of a sample, again and again."""

from __future__ import annotations

import re
from pathlib import Path

# as far as the sample folds its wings: farther and neighbours lose each other at the wrist
_FOLDED = (
    ", elbow = { mean = 4, harmonics = [[0, -6]] }, wrist = { mean = 4, harmonics = [[0, -8]] }"
)
SAMPLES = Path(__file__).resolve().parents[2] / "samples"


def flock(
    folder: Path, birds: int, apart: float, more: str = "", frames: int = 3, row: int = 2
) -> Path:
    """Write groom and shot; returns the shot. apart: m along x from bird to bird. row: feathers of
    each of a bird's four rows."""
    text = (SAMPLES / "flapping_bird/groom.toml").read_text()
    text = text.replace("count = 5", f"count = {row}")
    head, _, tail = text.partition("[[joint]]")
    body, _, rest = tail.partition("# Vanes as they were measured")
    body = "[[joint]]" + body

    def moved(bird: int) -> str:
        def shift(found: re.Match[str]) -> str:
            x, y, z = (float(each) for each in found[2].split(","))
            return f"{found[1]}[{x + apart * bird}, {y}, {z}]"

        own = re.sub(r"(position = )\[([^\]]+)\]", shift, body)
        return re.sub(r'((?:id|name|parent|joint) = )"([^"]+)"', rf'\1"b{bird}_\2"', own)

    groom = head + "".join(map(moved, range(birds))) + "# Vanes as they were measured" + rest
    (folder / "flock_groom.toml").write_text(groom)
    shot = folder / "flock.toml"
    shot.write_text(
        f'name = "flock"\ngroom = "flock_groom.toml"\nframes = [1, {frames}]\n'
        'frames_per_second = 30\nwind = "calm"\nquality = "draft"\n'
        f'motion = {{ base = "flap", wingbeat_frequency = 0.8333{_FOLDED} }}\n[contact]\n{more}'
    )
    return shot
