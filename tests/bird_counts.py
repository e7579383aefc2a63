"""Feathers of each tract of the shipped birds, as they grow on the bodies that are made for them.

`python -m tests.bird_counts [BIRD ...]` writes presets/bird/counts.json.
"""

import json
import sys
import tempfile
from collections import Counter
from pathlib import Path

from featherfx.api import groom_as_written, open_document
from tests.birds_image import BIRDS, GROOM, ROOT, run

COUNTS = ROOT / "presets/bird/counts.json"


def count_feathers(bird: str, folder: Path) -> dict[str, int]:
    """Return the feathers of each region of a species with folded wings."""
    maker = str(ROOT / "samples/pigeon/make_body.py")
    landmarks = run(folder, maker, f"{bird}_body.usdc", bird)
    groom = folder / f"{bird}.toml"
    groom.write_text(GROOM.format(bird=bird, landmarks=landmarks))
    feathers = groom_as_written(open_document("groom", groom)).feathers
    counts = Counter(each.region for each in feathers)
    return {region: counts[region] for region in sorted(counts)}


def main() -> None:
    """Count and write."""
    counts = json.loads(COUNTS.read_text())
    with tempfile.TemporaryDirectory() as folder:
        for bird in sys.argv[1:] or sorted(BIRDS):
            counts[bird] = count_feathers(bird, Path(folder))
    COUNTS.write_text(json.dumps(counts, indent=2) + "\n")


if __name__ == "__main__":
    main()
