"""Images of the pages, drawn again: `python -m tests.redraw [--check] [NAME ...]`.

The recipe of an image stands in its page: commands, also within comments, of which one writes the
image's name by -o. What they read is found by the -o of earlier commands, samples and docs/images.
All run in one folder, and a command that several images need runs once. With --check nothing is
replaced, and the exit code is 1 if an image differs from its recipe.
"""

import re
import resource
import shlex
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image, ImageSequence

ROOT = Path(__file__).resolve().parents[1]
MAX_DIFFERENCE = 2.0  # of 255, mean over all values of an image
# need Blender, and a page that is picked in; those of production_shot: by tests/test_page_runs.py
BY_HAND = {"blender.png", "view.png"}
BY_HAND |= {"body.png", "rest.png", "close.png", "free.png", "flight.png"}


@dataclass(frozen=True)
class Step:
    """A command of a page: its words, the files that it writes, and its comment (0: none)."""

    words: tuple[str, ...]
    writes: tuple[str, ...]
    comment: int


def steps_of(text: str) -> list[Step]:
    """Return the commands of a page that write files, in their order."""
    found, comments, inside = [], 0, False
    for line in re.sub(r"\\\n\s*", " ", text).splitlines():
        line = line.strip().removeprefix("$ ")
        inside = line.startswith("<!-- drawn by") or (inside and line != "-->")
        comments += line.startswith("<!-- drawn by")
        if re.match(r"(featherfx|python) [\w/]", line):
            words = tuple(
                shlex.split(re.split(r"\s+# |\s{3,}", line)[0], posix=line.count("'") % 2 == 0)
            )
            if "-o" in words[:-1]:
                output = words[words.index("-o") + 1]
                writes = (output, *([words[3]] if words[1] == "sample" else []))
                if "--overlay" in words:
                    writes += (words[words.index("--overlay") + 1],)
                found.append(Step(words, writes, comments if inside else 0))
    return found


def recipe(steps: list[Step], name: str) -> list[Step]:
    """Return the steps that an image needs, in their order; none if no step writes it.

    A comment is needed as a whole.
    """
    wanted, chosen, comment = {name}, [], 0
    for step in reversed(steps):
        written = {*step.writes, *(Path(path).name for path in step.writes)}
        if wanted & written or (comment and step.comment == comment):
            comment = comment if chosen else step.comment
            chosen.append(step)
            wanted -= {name, *step.writes}
            wanted.update(word for word in step.words if "." in word and word not in step.writes)
    return chosen[::-1]


def images_of(page: Path) -> Iterator[Path]:
    """Return the files of the images that a page shows, from its own folder."""
    for link in re.findall(
        r"!\[[^\]]*\]\(((?:docs/)?images/[^)]+)\)", page.read_text(encoding="utf-8")
    ):
        yield page.parent / link


def difference(first: Path, second: Path) -> float:
    """Return the mean difference of two images over all frames, of 255; inf for other sizes."""
    frames = []
    for path in (first, second):
        with Image.open(path) as image:
            frames.append(
                [np.asarray(f.convert("RGB"), float) for f in ImageSequence.Iterator(image)]
            )
    if [f.shape for f in frames[0]] != [f.shape for f in frames[1]]:
        return np.inf
    return float(np.mean([np.abs(a - b).mean() for a, b in zip(*frames, strict=True)]))


class Drawer:
    """A folder in which steps run; done: the words of the last step that wrote each file."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.done = folder, dict[str, tuple[str, ...]]()
        for name in ("samples", "docs", "tests"):
            ignored = shutil.ignore_patterns("__pycache__")
            shutil.copytree(ROOT / name, folder / name, ignore=ignored)

    def draw(self, steps: list[Step], image: str) -> Path | None:
        """Run the steps of an image that are not done; return its file, None if a step fails."""
        drawn = None
        for step in steps:
            if any(self.done.get(path) != step.words for path in step.writes):
                if not self._run(step):
                    return None
                # what read the files that this step has written is to be made again
                kept = {p: w for p, w in self.done.items() if not set(step.writes) & set(w)}
                self.done = kept | dict.fromkeys(step.writes, step.words)
            drawn = next((path for path in step.writes if Path(path).name == image), drawn)
        return self.folder / drawn if drawn else None

    def _run(self, step: Step) -> bool:
        module = ["-m", "featherfx"] if step.words[0] == "featherfx" else []
        command = [sys.executable, *module, *step.words[1:], *(["--overwrite"] if module else [])]
        return subprocess.run(command, cwd=self.folder, check=False).returncode == 0


def recipes() -> dict[Path, tuple[Path, list[Step]]]:
    """Return the page and the steps of each image that commands draw."""
    paths = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
    steps = {page: steps_of(page.read_text(encoding="utf-8")) for page in paths}
    # the page that shows an image may leave its commands to another one
    shown = {image: (page, *paths) for page in reversed(paths) for image in images_of(page)}
    return {
        image: (
            sources[0],
            next(filter(None, (recipe(steps[page], image.name) for page in sources)), []),
        )
        for image, sources in sorted(shown.items())
        if image.name not in BY_HAND
    }


def missing_inputs(steps: list[Step]) -> set[str]:
    """Return the files that steps read, and that are neither there nor written by earlier ones."""
    missing, written = set(), set()
    for step in steps:
        words = {word for word in step.words[1:] if re.search(r"\.(toml|usd[ac]?|py)$", word)}
        written |= {re.sub(r"\.\w+$", "", path) for path in step.writes}
        missing |= {
            word
            for word in words
            if not (ROOT / word).exists()
            and re.sub(r"(\.\d+of\d+)?\.\w+$", "", word) not in written
        }
    return missing


def redraw(names: list[str], check: bool) -> int:
    """Draw the images of all pages, or the named ones; return how many fail or differ."""
    wrong, spent = 0, 0.0
    with tempfile.TemporaryDirectory() as folder:
        drawer = Drawer(Path(folder))
        for image, (page, steps) in recipes().items():
            if names and image.name not in names:
                continue
            drawn = drawer.draw(steps, image.name)
            off = difference(drawn, image) if drawn and image.exists() else np.inf
            if drawn and not check and off > 0.0:
                shutil.copy(drawn, image)
            wrong += off > MAX_DIFFERENCE
            outcome = f"differs by {off:.2f} of 255" if drawn else "cannot be drawn by its page"
            usage = resource.getrusage(resource.RUSAGE_CHILDREN)
            before, spent = spent, usage.ru_utime + usage.ru_stime
            seconds = f"{spent - before:.0f} s of CPU time"
            print(f"{page.name}: {image.name} {outcome}, {seconds}", flush=True)
    return wrong


if __name__ == "__main__":
    arguments = sys.argv[1:]
    checking = "--check" in arguments
    sys.exit(bool(redraw([each for each in arguments if each != "--check"], checking) and checking))
