"""Studies, their verdicts and the report."""

import json
import math
import os
import re
import time

import pytest
from commands import invoke
from places import ROOT

from featherfx.errors import InputError, SimulationError
from featherfx.lab.studies import report, study
from featherfx.lab.studies.study import (
    Comparisons,
    Study,
    StudyResult,
    independent,
    ourselves,
    published,
    run_study,
)


def row(way, *values, **options):
    """The one that a method of Rows adds."""
    rows = Comparisons()
    getattr(rows, way)(*values, **options)
    return rows[0]


def compared(*values, **options):
    return row("compare", *values, **options)


def bounded(*values, **options):
    return row("bound", *values, **options)


def reported(*values):
    return row("report", *values)


BOOK, OTHER, OWN = published("a book"), independent("another method"), ourselves("a finer mesh")


@pytest.mark.parametrize(
    ("row", "verdict"),
    [
        (compared("a", 1.01, 1.0, 0.02, BOOK), "agrees"),
        (compared("a", 1.03, 1.0, 0.02, BOOK), "differs"),
        (compared("a", -1.03, -1.0, 0.02, BOOK), "differs"),
        (compared("a", 1.03, 1.0, 0.05, BOOK, absolute=True), "agrees"),
        (compared("a", math.nan, 1.0, 10.0, BOOK), "differs"),
        (bounded("a", 1.0, OTHER, at_most=0.5), "differs"),
        (bounded("a", 1.0, OTHER, at_least=0.5), "agrees"),
        (bounded("a", math.nan, OTHER, at_least=0.5), "differs"),
        (bounded("a", math.nan, OTHER, at_most=0.5), "differs"),
        (bounded("a", 1.0, published("a book, in words"), at_most=1.0), "holds"),
        (bounded("a", 1.1, published("a book, in words"), at_most=1.0), "fails"),
        (reported("a", 7.0), "no comparison"),
    ],
)
def test_verdict_follows_from_the_numbers(row, verdict):
    assert row.verdict == verdict


def test_one_number_that_differs_makes_a_study_differ():
    good, bad = bounded("a", 1.0, OTHER, at_most=2.0), bounded("a", 3.0, OTHER, at_most=2.0)
    assert StudyResult([good, reported("b", 1.0)]).verdict == "agrees"
    assert StudyResult([good, bad]).verdict == "differs"
    assert StudyResult([reported("b", 1.0)]).verdict == "no comparison"


def test_what_agrees_only_with_ourselves_confirms_nothing():
    own, other = bounded("a", 1.0, OWN, at_most=2.0), bounded("a", 1.0, OTHER, at_most=2.0)
    assert StudyResult([own, reported("b", 1.0)]).verdict == "only with itself"
    assert StudyResult([own, other]).verdict == "agrees"
    assert StudyResult([bounded("a", 3.0, OWN, at_most=2.0)]).verdict == "differs"


def test_registry_names_are_unique_and_lead_to_functions():
    names = [each.name for each in study.STUDIES]
    assert len(set(names)) == len(names)
    for each in study.STUDIES:
        assert callable(each.run)


def trial(folder):
    def paint(canvas):
        canvas.add_subplot().plot([0, 1], [0, 1])

    rows = [
        compared("length <of> a | b", 1.0, 2.0, 0.1, BOOK, unit="m", note="too short"),
        reported("n", 3),
    ]
    return StudyResult(rows, study.draw(folder / "trial.png", "A line & more.", paint))


def alone(folder):
    rows = Comparisons()
    rows.report("length", 2.0, unit="m")
    rows.report("seconds", 2.0, unit="s")
    rows.report("none", math.nan)
    return StudyResult(rows)


def broken(folder):
    raise SimulationError("feather", 1.0, "it did not converge")


def place(function):
    return f"{__name__}:{function.__name__}"


def entries(tmp_path, *functions):
    chosen = [Study(f.__name__, f"The {f.__name__}", "nobody", place(f)) for f in functions]
    return report.run_all(chosen, tmp_path, compile_first=())


def test_report_holds_every_number_and_picture(tmp_path):
    pytest.importorskip("matplotlib")
    done = entries(tmp_path, trial, broken)
    files = report.write_report(tmp_path, done, "1.2.3")
    assert [file.name for file in files] == ["validation.html", "validation.json", "validation.csv"]
    page = files[0].read_text()
    assert "length &lt;of&gt; a | b" in page
    assert "data:image/png;base64," in page
    assert "A line &amp; more." in page
    assert "it did not converge" in page
    studies = json.loads(files[1].read_text())["studies"]
    assert studies["trial"]["rows"][0]["value"] == 1.0
    assert studies["trial"]["rows"][0]["kind"] == "published"
    assert studies["trial"]["rows"][0]["source"] == "a book"
    assert studies["trial"]["verdict"] == studies["broken"]["verdict"] == "differs"
    assert files[2].read_text().splitlines()[1].startswith("trial,length <of> a | b,1.0,m,2.0,")
    page = tmp_path / "page.md"
    report.write_markdown(page, done, "1.2.3")
    text = page.read_text()
    for figure in done[0].result.figures:
        assert (tmp_path / "page" / figure.file.name).exists()
        assert f"](page/{figure.file.name})" in text
    assert (
        "| length <of> a \\| b | 1 | m | 2 | 10 % | published | differs | a book | too short |"
        in text
    )
    assert "Of 3 numbers, 0 agree and 1 differ with published ones" in text
    assert "0 agree and 1 differ with ourselves, which does not count; 1 have nothing" in text


def test_studies_that_were_not_run_stay_on_the_page(tmp_path):
    done = report.run_all(study.studies(["elastica"]), tmp_path, compile_first=())
    page = tmp_path / "page.md"
    report.write_markdown(page, done, "1")
    first = page.read_text()
    more = report.run_all(study.studies(["frequencies"]), tmp_path, compile_first=())
    report.write_markdown(page, more, "1")
    text = page.read_text()
    row = next(line for line in first.splitlines() if "shortening / L" in line)
    assert row in text.splitlines()
    assert text.index("`elastica`") < text.index("`frequencies`")
    kept = json.loads((tmp_path / "page" / report.RECORD_FILE).read_text())["studies"]
    assert list(kept) == ["elastica", "frequencies"]
    assert report.moved(done, {"studies": kept}) == []


def test_without_matplotlib_there_are_tables_and_it_says_so(tmp_path, monkeypatch):
    for module in (study, report):
        monkeypatch.setattr(module, "can_plot", lambda: False)
    done = entries(tmp_path, trial)
    assert done[0].result.figures == ()
    assert report.NO_PLOTS in report.markdown(done, "1")


def test_studies_are_timed_and_imported_late(tmp_path):
    result = run_study(Study("x", "x", "x", place(trial)), tmp_path / "new")
    assert 0.0 < result.seconds < 60.0
    assert len(result.rows) == 2


def test_a_number_that_moves_by_a_tenth_of_its_tolerance_is_named(tmp_path):
    before = report.record(entries(tmp_path, trial), "1")
    now = entries(tmp_path, trial)
    assert report.moved(now, before) == []
    before["studies"]["trial"]["rows"][0]["value"] = 1.021
    assert report.moved(now, before) == ["trial, length <of> a | b: 1.021 -> 1.0"]
    before["studies"]["trial"]["rows"][0] |= {"value": 1.0, "source": "another book"}
    assert report.moved(now, before) == ["trial, length <of> a | b: held against something else"]
    before["studies"]["trial"]["rows"].pop()
    assert report.moved(now, before) == ["trial: other numbers than before"]


def test_a_number_alone_may_move_by_a_thousandth_and_a_time_as_it_likes(tmp_path):
    now, before = entries(tmp_path, alone), report.record(entries(tmp_path, alone), "1")
    values = before["studies"]["alone"]["rows"]
    values[0]["value"], values[1]["value"] = 2.0019, 5.0
    assert report.moved(now, before) == []
    values[0]["value"] = 2.0021
    assert report.moved(now, before) == ["alone, length: 2.0021 -> 2.0"]
    values[0]["value"], values[2]["value"] = 2.0, 1.0
    assert report.moved(now, before) == ["alone, none: 1.0 -> nan"]


def test_the_page_is_of_today(tmp_path):
    page = ROOT / "docs/validation/validation.json"
    quick = study.studies(
        [
            *("elastica", "frequencies", "fibre_merging", "fibre_space", "heavy_elastica"),
            *("bend_45", "released_rod"),
            *("vane_mesoscale", "guard_truss", "feather_masses", "ribbon_shell", "tissue_laws"),
            "feathers_in_air",
        ]
    )
    now = report.run_all(quick, tmp_path, compile_first=())
    assert report.moved(now, json.loads(page.read_text())) == []


def test_published_places_have_their_pages():
    assert published("Houghton 2020, figures 6.16 and 6.17, in words").text == (
        "Houghton 2020, figures 6.16 (p. 121) and 6.17 (p. 122), in words"
    )
    assert published("a book, table 1.2").text == "a book, table 1.2"
    with pytest.raises(KeyError, match=r"table 9\.9"):
        published("Jouve 2024, table 9.9")
    listed = json.loads((ROOT / "docs/validation/validation.json").read_text())["studies"].values()
    rows = [row for each in listed for row in each["rows"] if row["kind"] == "published"]
    texts = {row["source"] for row in rows if row["source"].split(",")[0] in study.PAGES}
    assert len(texts) > 30
    assert all(re.search(r"\(pp?\. \d", text) for text in texts)


def slow_then(folder):
    time.sleep(0.5)
    return StudyResult([reported("process", os.getpid())])


def quick(folder):
    return StudyResult([reported("process", os.getpid())])


def test_studies_run_in_processes_and_keep_their_order(tmp_path):
    chosen = [Study(f.__name__, "x", "x", place(f)) for f in (slow_then, quick, broken)]
    told = []
    done = report.run_all(
        chosen,
        tmp_path,
        lambda entry, k, total: told.append((entry.study.name, k, total)),
        jobs=2,
        compile_first=(),
    )
    assert [entry.study.name for entry in done] == ["slow_then", "quick", "broken"]
    assert all(entry.result.rows[0].ours != os.getpid() for entry in done)
    assert done[2].result.verdict == "differs"
    assert sorted(name for name, _, _ in told) == ["broken", "quick", "slow_then"]
    assert [(k, total) for _, k, total in told] == [(1, 3), (2, 3), (3, 3)]


def late(folder):
    return StudyResult([reported("kernels", (folder / "kernels").exists())])


def test_kernels_are_compiled_before_the_first_study(tmp_path):
    chosen = [Study("x", "x", "x", place(late))]
    done = report.run_all(chosen, tmp_path, compile_first=((tmp_path / "kernels").touch,))
    assert done[0].result.rows[0].ours == 1.0


def test_pictures_make_their_folder(tmp_path):
    pytest.importorskip("matplotlib")
    file = tmp_path / "new" / "picture.png"
    assert study.draw(file, "x", lambda canvas: canvas.subplots())[0].file == file
    assert file.read_bytes().startswith(b"\x89PNG")


def test_unknown_study():
    with pytest.raises(InputError, match="no_such"):
        study.studies(["no_such"])
    result = invoke("lab", "report", "-o", "x", "--only", "no_such")
    assert result.exit_code == 1
    assert "elastica" in result.stderr


@pytest.mark.slow
def test_report_from_the_command_line(tmp_path):
    arguments = ["lab", "report", "-o", str(tmp_path / "out"), "--only", "elastica"]
    page = tmp_path / "docs" / "validation.md"
    result = invoke(*arguments, "--markdown", page)
    assert result.exit_code == 0, result.stderr
    assert "elastica" in page.read_text()
    assert (tmp_path / "out" / "validation.html").exists()


def test_ribbon_and_unit_cell_commands_give_their_keys():
    strip = ("--length", "0.1", "--width", "0.01", "--rigidity", "2e-4", "--density", "0.1")
    result = invoke("lab", "ribbon", *strip, "--json")
    found = json.loads(result.stdout)
    assert found["tip"] == found["points"][-1]
    assert found["stability"] > 0.0
    result = invoke("lab", "unitcell", "--preset", "swan_primary", "--json")
    assert json.loads(result.stdout)["along"] == pytest.approx(3.6e8, rel=1e-2)
