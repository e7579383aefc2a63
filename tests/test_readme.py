"""The two commands of the README: what continuous integration runs is what the reader sees."""

import re
import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent


def commands():
    blocks = re.findall(r"^```sh\n(.*?)```", (ROOT / "README.md").read_text(), re.S | re.M)
    return [block.strip() for block in blocks[:2]]


def test_both_commands_are_one_line_and_start_from_nothing():
    for command in commands():
        assert "\n" not in command
        assert command.startswith("python3 -m venv .venv && .venv/bin/pip install ")


def test_first_command_bakes_a_sample_that_exists():
    shot = re.search(r"featherfx bake (\S+)", commands()[0])[1]
    assert (ROOT / shot).is_file()
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    assert text.partition("## Two commands")[2].partition("```sh\n")[2].startswith(commands()[0])
    assert "-o pigeon.usdc && " in commands()[0]
    assert re.search(r"view pigeon\.usdc --html pigeon\.html\b", commands()[0])


def test_continuous_integration_runs_the_second_command_as_written():
    script = (ROOT / ".ci/run").read_text()
    assert commands()[1] in script.splitlines()
    assert (ROOT / ".ci/run").stat().st_mode & 0o111
    for step in ("ruff format --check", "ruff check", "mypy", "pytest"):
        assert step in commands()[1]


def test_extras_named_in_the_documents_exist():
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    known = extras["optional-dependencies"].keys()
    for document in (ROOT / "README.md", *(ROOT / "docs").glob("*.md")):
        named = re.findall(r"(?:featherfx|'\.|\"\.)\[(\w+)\]", document.read_text())
        assert set(named) <= known, document


def test_links_of_the_documents_lead_somewhere():
    for document in (ROOT / "README.md", *(ROOT / "docs").glob("*.md")):
        for link in re.findall(r"\]\(([^)#:]+)\)", document.read_text()):
            assert (document.parent / link).exists(), f"{document.name}: {link}"
