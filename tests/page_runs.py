"""Commands of pages, run in one folder on the files that a page shows, as a reader would.

A block of `sh` holds commands; `<!-- run: COMMAND -->` holds one that a page leaves to its reader.
A block of `text` right after commands is their output, with other numbers. On pages of Start a
block of `toml` is the file that the paragraph before it names. Servers are stopped by Ctrl-C.
"""

import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from pages import ROOT, sections

# what installs, and what is of other programs
NOT_RUN = ("python3 -m venv ", "pip ", ".venv/bin/", "openjd ")
READERS = ("Start", "How-to", "Reference")
# a shot of twenty feathers whose wings beat twice, under the names that how-to pages use
SHOTS = ("shot.toml", "a.toml", "b.toml")
CACHES = ("wing.usdc", "swan_wing.usdc", "flap.usdc", "new.usdc", "old.usdc", "wing.usda")

# what stands behind a number that is the same in each run
_COUNTED = r"\\ (?:feathers|taken|faces|points|joints|values)\b"


@dataclass(frozen=True)
class Block:
    """A block of a page: its language ("run": hidden), content, and the paragraph before it."""

    kind: str
    text: str
    before: str


def read_blocks(text: str) -> Iterator[Block]:
    """Return the blocks of a page in their order."""
    pattern = r"^```(\w+)\n(.*?)^```|^<!-- (run): (.*?) -->"
    last = 0
    for each in re.finditer(pattern, text, re.S | re.M):
        before = text[last : each.start()].strip().rsplit("\n\n", 1)[-1]
        yield Block(each[1] or each[3], each[2] or each[4], before)
        last = each.end()


def read_commands(block: Block) -> list[str]:
    """Return the commands of a block, one a line, without comments."""
    if block.kind not in ("sh", "run"):
        return []
    lines = re.sub(r"\\\n\s*", " ", block.text).splitlines()
    lines = [part for line in lines for part in re.sub(r"\s+# .*", "", line).split(" && ")]
    return [line.strip() for line in lines if line.strip()]


def pages_with_commands() -> dict[str, list[str]]:
    """Return the commands of each page for readers."""
    parts = sections()
    names = [name for part in READERS for name in parts[part] if name != "commands.md"]
    texts = {name: (ROOT / "docs" / name).read_text(encoding="utf-8") for name in names}
    found = {
        name: [command for block in read_blocks(text) for command in read_commands(block)]
        for name, text in texts.items()
    }
    return {name: commands for name, commands in found.items() if commands}


def run(command: str, folder: Path) -> str:
    """Run one command and return what it prints; AssertionError where it fails."""
    words = [word.replace("/show/", f"{folder}/show/") for word in shlex.split(command)]
    if "-o" in words and not {"--resume", "--overwrite"} & {*words}:
        (folder / words[words.index("-o") + 1]).unlink(missing_ok=True)
    path = str(ROOT)
    if words[0].startswith("PYTHONPATH="):
        path += f":{words.pop(0).partition('=')[2]}"
    if words[0] in ("featherfx", "python"):
        words[:1] = [sys.executable, *(["-m", "featherfx"] if words[0] == "featherfx" else [])]
    serves = words[3:4] in (["view"], ["tune"]) and "--html" not in words
    process = subprocess.Popen(
        [*words, "--no-browser"] if serves else words,
        cwd=folder,
        env={**os.environ, "PYTHONPATH": path, "HOME": str(folder / "home")},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    assert process.stdout is not None
    if serves:
        line = next((line for line in process.stdout if "http://" in line), "no address")
        process.send_signal(signal.SIGINT)
        assert "http://" in line, f"{command}\n{line}"
    output = process.communicate(timeout=1200)[0]
    assert process.returncode == 0, f"{command}\n{output}"
    return output


def compare_output(expected: str, output: str) -> None:
    """Compare lines of a page with those of a command, in their order.

    Numbers may be others, but for counts of feathers and of a mesh.
    """
    place = 0
    for line in filter(lambda each: each.strip() != "...", expected.strip().splitlines()):
        text = re.escape(line.strip()).replace(r"\.", ".")
        pattern = re.sub(rf"\d[\d.,e]*+(?!{_COUNTED})", r"[\\d.,e]+", text)
        found = re.compile(pattern).search(output, place)
        assert found, f"{line}\nis not in\n{output}"
        place = found.end()


def prepare(folder: Path) -> None:
    """Write the inputs that how-to pages name: shots, caches, a camera, a photograph."""
    shutil.copytree(ROOT / "samples/swan_wing", folder)
    text = (folder / "shot.toml").read_text(encoding="utf-8").replace("[1, 24]", "[1, 48]")
    for name in SHOTS:
        (folder / name).write_text(text, encoding="utf-8")
    shutil.copy(ROOT / "docs/images/patterns.toml", folder)
    for name in CACHES:
        run(f"featherfx bake shot.toml -o {name}", folder)
    shutil.copy(folder / "wing.usda", folder / "bird.usda")
    camera = (ROOT / "samples/owl_flight/cameras.usda").read_text(encoding="utf-8")
    (folder / "cameras.usda").write_text(camera.replace('"front"', '"main"'), encoding="utf-8")


def run_page(name: str, folder: Path, inputs: Path) -> None:
    """Run a page's commands in a folder and compare what they print; inputs: by `prepare`."""
    start = name in sections()["Start"]
    for part in ("samples", "tests", "docs"):
        shutil.copytree(ROOT / part, folder / part, ignore=shutil.ignore_patterns("__pycache__"))
    (folder / "home/houdini20.5").mkdir(parents=True)  # where plugins find it
    if not start:
        shutil.copytree(inputs, folder, dirs_exist_ok=True)
    here, output = folder, ""
    for block in read_blocks((ROOT / "docs" / name).read_text(encoding="utf-8")):
        named = re.findall(r"`((?:mine/)?\w+\.toml)`", block.before)
        if block.kind == "toml" and start and named:
            file = here / named[-1]
            file.parent.mkdir(exist_ok=True)
            adds = "the end of" in block.before
            file.write_text(file.read_text() + "\n" + block.text if adds else block.text)
        elif block.kind == "text" and output and not block.before:
            compare_output(block.text, output)
        else:
            output = ""
        for command in read_commands(block):
            if command.startswith("cd "):
                here = here / command[3:]
            elif not command.startswith(NOT_RUN) and "activate" not in command:
                output += run(command, here)
