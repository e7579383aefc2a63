"""Rules for pages: words, sentences, links, terms and names. `python -m tests.pages` judges them.

`python -m tests.pages commands` writes docs/commands.md from the help of each command.

Code blocks are no words; tables are words and no sentences. What a command wrote counts as neither:
whole pages (GENERATED), and what stands between `<!-- made by: COMMAND -->` and `<!-- end -->`.
"""

import json
import math
import re
import sys
from dataclasses import dataclass
from pathlib import Path
from statistics import mean

from click.testing import CliRunner
from PIL import Image, ImageSequence

from featherfx.cli.main import main
from featherfx.groom.keys.renamed import RENAMED

ROOT = Path(__file__).resolve().parents[1]
GENERATED = {
    "reference.md",
    "commands.md",
    "validation.md",
    "validation_networks.md",
    "api.md",
    "peers.md",
}
# figures with the date of their measurement
EVIDENCE = {"benchmarks.md", "measurements.md", "skips.md"}
MAX_WORDS = 40_000  # of all pages
MAX_SENTENCE, MAX_MEAN_SENTENCE = 25, 18  # words
# options of other programs, and joints that a groom makes
FOREIGN = {"--nworkers", "--nthreads", "right_wing_wrist"}
WORDS_A_MINUTE, WORDS_AN_IMAGE = 200, 500
# minutes in which one reads the pages that a task needs, README first
PATHS = {
    "first feather on my mesh": (5, "first_feather"),
    "bird from my rig": (8, "first_bird skins"),
    "art-direct": (10, "direction colours"),
    "farm": (8, "farm"),
    "into a host": (6, "dcc"),
}
# words of the pages of a section of the site
SECTIONS = {"Start": 3_500, "How-to": 12_000, "Explanation": 6_000}
MAX_IMAGE, MIN_FILM, MAX_FILM = 1_000_000, 5.0, 10.0  # bytes; s
# sections whose pages show what one gets, and their pages that have nothing to show
SHOWN = ("Start", "How-to")
# names in reports and pages, which keys had, too
MEASURES = {"overlap", "parts", "body"}
# feathers of each species by region, as `python -m tests.bird_counts` counts them
BIRD_COUNTS = json.loads((ROOT / "presets/bird/counts.json").read_text(encoding="utf-8"))
# what a page may have, in words; each other one has the last
BUDGETS = {"README.md": 400, "usd.md": 1_700, "glossary.md": 600}
MAX_HOW_TO, MAX_PAGE = 900, 1_500
# the glossary's "instead of", as far as no field uses these words otherwise
AVOIDED = (
    r"laid coat|coat feathers?|laid over|who lies over whom|sub-steps?|run-up|processor time|"
    r"comes? to rest|room mates?|left out of account|contour plume|left out, without more|"
    r"as of today|no longer(?! than)|used to be|formerly"
)


@dataclass(frozen=True)
class Page:
    """A page: its name and text, its words with those of tables, and its sentences."""

    name: str
    text: str
    words: int
    sentences: tuple[str, ...]


def read_page(path: Path) -> Page:
    """Read a page and split its prose into sentences."""
    text = path.read_text(encoding="utf-8")
    prose = re.sub(r"^<!-- made by:.*?^<!-- end -->", "", text, flags=re.S | re.M)
    prose = re.sub(r"<!--.*?-->", "", prose, flags=re.S)
    prose = re.sub(r"^(```|~~~).*?^\1", "\n\n", prose, flags=re.S | re.M)
    prose = re.sub(r"(^|\n)\n(    |\t)(?![-*\d]).*(\n+(    |\t).*)*", "\n\n", prose)
    prose = re.sub(r"!?\[([^\]]*)\]\([^)]*\)", r"\1", prose)
    words = len(re.findall(r"[^\s|]*\w[^\s|]*", prose))
    prose = re.sub(r"^(\||#|<|!\[|---).*$", "\n\n", prose, flags=re.M)
    prose = re.sub(r"`([^`\n]*)`", lambda code: code[1].replace(".", "_").replace(" ", "_"), prose)
    prose = re.sub(r"^\s*([-*]|\d+\.)\s+", "\n\n", prose, flags=re.M)
    parts = re.split(r"\n\s*\n|(?<=[.!?:;])[*)\"']*\s+", prose)
    sentences = tuple(" ".join(each.split()) for each in parts if re.search(r"\w", each))
    return Page(str(path.relative_to(ROOT)), text, words, sentences)


def pages() -> list[Page]:
    """Return all pages that are written by hand."""
    paths = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]
    return [read_page(path) for path in paths if path.name not in GENERATED]


def anchors(path: Path) -> set[str]:
    """Return the anchors of a page's headings, as sites of Markdown make them."""
    headings = re.findall(r"^#+ (.*)$", path.read_text(encoding="utf-8"), re.M)
    plain = (re.sub(r"[^\w\- ]", "", heading.lower()) for heading in headings)
    return {re.sub(r"[ ]+", "-", heading.strip()) for heading in plain}


def broken_links(page: Page) -> list[str]:
    """Return the links of a page that lead nowhere."""
    here, broken = ROOT / page.name, []
    prose = re.sub(r"^```.*?^```", "", page.text, flags=re.S | re.M)
    for link in re.findall(r"\]\(([^)\s]+)\)", prose):
        if re.match(r"\w+:", link):
            continue
        file, _, anchor = link.partition("#")
        target = here.parent / file if file else here
        if not target.exists() or (anchor and anchor not in anchors(target)):
            broken.append(link)
    return broken


def known_names() -> str:
    """Return all text in which a name of the program may stand."""
    suffixes = {".py", ".toml", ".js", ".html", ".sh", ".usda"}
    folders = ("featherfx", "presets", "samples", "tests", ".ci")
    files = [path for folder in folders for path in (ROOT / folder).rglob("*") if path.is_file()]
    texts = [path.name for path in files]
    texts += [path.read_text(encoding="utf-8") for path in files if path.suffix in suffixes]
    return "\n".join([*texts, (ROOT / "docs/reference.md").read_text(encoding="utf-8")])


def unknown_names(page: Page, known: str) -> list[str]:
    """Return names with an underscore, and options, that no file of the program has."""
    spans = re.findall(r"`([^`\n]+)`", re.sub(r"^```.*?^```", "", page.text, flags=re.S | re.M))
    names = {name for span in spans for name in re.findall(r"\b[a-z]+(?:_[a-z]+)+\b", span)}
    options = {name for span in spans for name in re.findall(r"--([a-z][a-z-]+)", span)}
    unknown = {name for name in names if name not in known}
    keys = set(re.findall(r"^\| `(\w+)`", known, re.M)) | MEASURES
    unknown |= {old for _, old, _ in RENAMED if old in spans and old not in keys}
    # some options are declared by the fields that they set
    unknown |= {f"--{n}" for n in options if n not in known and n.replace("-", "_") not in known}
    return sorted(unknown - FOREIGN)


def made_blocks(text: str) -> list[tuple[str, str]]:
    """Return the commands that made parts of a page, and these parts."""
    return re.findall(r"^<!-- made by: (.*?) -->\n(.*?)^<!-- end -->", text, re.S | re.M)


def typed_figures(text: str) -> list[str]:
    """Return rows of tables with measured figures that no command made."""
    typed = re.sub(r"^<!-- made by:.*?^<!-- end -->", "", text, flags=re.S | re.M)
    rows = [line for line in typed.splitlines() if line.startswith("|")]
    figures = re.compile(r"\|[^|`]*\d\.\d[^|`a-z]*(?=\|)")
    return [row for row in rows if len(figures.findall(row)) > 1]


def faults(page: Page, known: str) -> list[str]:
    """Return what is wrong with a page, a line each."""
    found = [f"leads nowhere: {link}" for link in broken_links(page)]
    name = Path(page.name).name
    limit = BUDGETS.get(name, MAX_HOW_TO if name in sections()["How-to"] else MAX_PAGE)
    if page.words > limit:
        found.append(f"{page.words} words, {limit} allowed")
    lengths = [len(sentence.split()) for sentence in page.sentences]
    if lengths and mean(lengths) > MAX_MEAN_SENTENCE:
        found.append(f"{mean(lengths):.1f} words a sentence, {MAX_MEAN_SENTENCE} allowed")
    long = [s for s in page.sentences if len(s.split()) > MAX_SENTENCE]
    found += [f"{len(s.split())} words in a sentence: {s[:60]}..." for s in long]
    prose = "\n".join(page.sentences)
    if name not in EVIDENCE:
        found += [f"a date: {date}" for date in re.findall(r"\b20\d\d-\d\d-\d\d\b", prose)]
        if "decisions" not in page.name:
            found += [f"figures that no command made: {row}" for row in typed_figures(page.text)]
    counts = {f"{sum(each.values()):,}" for each in BIRD_COUNTS.values()}
    told = set(re.findall(r"\b(\d+,\d{3})\s+feathers", page.text))
    found += [f"no bird has {count} feathers" for count in sorted(told - counts)]
    if name != "dcc.md":  # names of other programs
        found += [f"does not exist: {name}" for name in unknown_names(page, known)]
    return found + [f"wrong term: {term}" for term in re.findall(AVOIDED, prose)]


def best_pages(query: str) -> list[str]:
    """Return names of pages in the order in which a search for some words lists them.

    A word counts tenfold in a title and fivefold in a heading, with saturation, and by how few
    pages have it (BM25 without length weights).
    """
    every = pages()
    scores = dict.fromkeys((Path(page.name).name for page in every), 0.0)
    for word in query.lower().split():
        stem = re.compile(rf"\b{re.escape(word.rstrip('s'))}", re.I)
        weights = {}
        for page in every:
            lines = page.text.splitlines()
            title = 10.0 * bool(lines and stem.search(lines[0]))
            headings = 5.0 * sum(bool(stem.search(x)) for x in lines[1:] if x.startswith("##"))
            count = len(stem.findall(page.text))
            weights[Path(page.name).name] = (title + headings + count) / (
                title + headings + count + 8
            )
        having = sum(weight > 0.0 for weight in weights.values())
        for name, weight in weights.items():
            scores[name] += weight * math.log(1.0 + len(every) / (1.0 + having))
    return sorted(scores, key=lambda name: -scores[name])


def sections() -> dict[str, list[str]]:
    """Return the pages of each section of the site."""
    path = Path(__file__).resolve().parents[1] / "mkdocs.yml"
    text, found = path.read_text(encoding="utf-8"), {}
    for name, entries in re.findall(r"^  - ([\w -]+):\n((?:      - .*\n)+)", text, re.M):
        found[name] = re.findall(r"- (?:.*/)?(\w+\.md)", entries)
    return found


def film_seconds(path: Path) -> float:
    """Return how long a film plays, in s."""
    with Image.open(path) as film:
        return sum(each.info["duration"] for each in ImageSequence.Iterator(film)) / 1000


def faults_of_all(every: list[Page]) -> list[str]:
    """Return what is wrong with the pages as a whole: minutes, budgets, and images."""
    words = {Path(page.name).name: page.words for page in every}
    texts = {Path(page.name).name: page.text for page in every}
    found = []
    for task, (allowed, names) in PATHS.items():
        read = words["README.md"] + sum(words[f"{name}.md"] for name in names.split())
        if read > allowed * WORDS_A_MINUTE:
            minutes = read / WORDS_A_MINUTE
            found.append(f"{task}: {minutes:.1f} minutes of reading, {allowed} allowed")
    parts = sections()
    for name, limit in SECTIONS.items():
        if (count := sum(words.get(page, 0) for page in parts[name])) > limit:
            found.append(f"{name}: {count} words, {limit} allowed")
    for page in {page for name in SHOWN for page in parts[name]}:
        shown, needed = texts[page].count("](images/"), math.ceil(words[page] / WORDS_AN_IMAGE)
        if shown < needed:
            found.append(f"{page}: {shown} images of the result, {needed} needed")
    for image in sorted((ROOT / "docs").rglob("*.*")):
        if image.suffix in (".png", ".gif", ".jpg") and image.stat().st_size > MAX_IMAGE:
            found.append(f"{image.name}: {image.stat().st_size} bytes, {MAX_IMAGE} allowed")
        if image.suffix == ".gif" and not MIN_FILM <= film_seconds(image) <= MAX_FILM:
            allowed = f"{MIN_FILM:g} to {MAX_FILM:g} allowed"
            found.append(f"{image.name}: plays for {film_seconds(image):g} s, {allowed}")
    total = sum(words.values())
    return found + [f"{total} words, {MAX_WORDS} allowed"] * (total > MAX_WORDS)


def describe_commands() -> str:
    """Return the page of all commands: what `--help` prints, at 100 columns."""
    text = (
        "# Commands\n\nWhat `featherfx COMMAND --help` prints (`python -m tests.pages commands`).\n"
    )
    for name in sorted(main.commands):
        shown = CliRunner().invoke(
            main, [name, "--help"], prog_name="featherfx", terminal_width=100
        )
        text += f"\n## {name}\n\n```text\n{shown.output.rstrip()}\n```\n"
    return text


def check() -> int:
    """Print words by page and all faults; return the number of faults."""
    every, known = pages(), known_names()
    count = 0
    for page in sorted(every, key=lambda each: each.words):
        wrong = faults(page, known)
        count += len(wrong)
        print(f"{page.words:6d}  {page.name}", *(f"        {fault}" for fault in wrong), sep="\n")
    whole = faults_of_all(every)
    total = sum(page.words for page in every)
    print(f"{total:6d}  in all, {MAX_WORDS} allowed; {count + len(whole)} faults", *whole, sep="\n")
    return count + len(whole)


if __name__ == "__main__":
    if sys.argv[1:] == ["commands"]:
        (ROOT / "docs/commands.md").write_text(describe_commands(), encoding="utf-8")
    else:
        sys.exit(bool(check()))
