"""Machine code that comes with the program."""

import shutil
from zipfile import ZipFile

import pytest
from kernel_runs import ALL, NONE, flip, run_in

from featherfx.jit import ship, shipped

SHIPPED = """
from pathlib import Path
from featherfx.jit import shipped
shipped.FOLDER = Path(FOLDER)
"""


@pytest.fixture(scope="module")
def shipped_code(tmp_path_factory):
    """What a machine that builds wheels has compiled, for a common processor."""
    if not shipped.of_this_machine():
        pytest.skip("no machine code is shipped for this processor")
    folder = tmp_path_factory.mktemp("shipped")
    for_it = {"NUMBA_CPU_NAME": shipped.of_this_machine()[0].name, "NUMBA_CPU_FEATURES": ""}
    run_in(folder / "here", "trial_types", "", for_it | {"FEATHERFX_CACHE": str(folder / "code")})
    return folder / "code"


def test_machine_code_that_came_with_the_program_is_loaded(run_kernels, tmp_path, shipped_code):
    before = SHIPPED.replace("FOLDER)", f"{str(shipped_code)!r})")
    assert run_kernels(tmp_path / "here", before=before) == ["4.0", NONE]
    assert not list((tmp_path / "cache").rglob("*.code"))
    # not for a processor that it may not be for
    other = {"NUMBA_CPU_NAME": "x86-64-v2", "NUMBA_CPU_FEATURES": ""}
    assert run_kernels(tmp_path / "here", before=before, **other) == ["4.0", ALL]


@pytest.mark.parametrize(
    "harm",
    [
        pytest.param(flip, marks=pytest.mark.slow),
        pytest.param(lambda file: file.chmod(0o666), id="open"),
    ],
)
def test_shipped_code_that_was_changed_or_could_be_is_not_loaded(
    run_kernels, tmp_path, shipped_code, harm
):
    folder = shutil.copytree(shipped_code, tmp_path / "code")
    for file in folder.rglob("*.code"):
        harm(file)
    before = SHIPPED.replace("FOLDER)", f"{str(folder)!r})")
    assert run_kernels(tmp_path / "here", before=before) == ["4.0", ALL]
    assert run_kernels.stderr.count("InputWarning") == (harm is not flip)


def test_all_that_was_compiled_is_put_into_the_wheels_folder(
    tmp_path, monkeypatch, capsys, compiled_once
):
    def compiled(folder, processor):
        shutil.copytree(compiled_once[1], folder, dirs_exist_ok=True)

    monkeypatch.setattr(ship, "fill", compiled)
    monkeypatch.setattr(ship, "FOLDER", tmp_path / "code")
    (tmp_path / "code" / "old").mkdir(parents=True)
    ship.main()
    assert capsys.readouterr().out.count(": 3 kernels, 0.") == len(shipped.of_this_machine())
    found = {each.name: each.read_bytes() for each in (tmp_path / "code").glob("*/*")}
    compiled = {each.name: each.read_bytes() for each in compiled_once[1].glob("*/*.code")}
    assert found == compiled


def test_a_checkout_takes_the_machine_code_of_a_wheel(tmp_path, monkeypatch, compiled_once):
    monkeypatch.setattr(ship, "FOLDER", tmp_path / "new" / "code")
    wheel = tmp_path / "a.whl"
    with pytest.raises(SystemExit, match=r"a\.whl: .*No such file"):
        ship.main(str(wheel))
    entries = list(compiled_once[1].glob("*/*.code"))
    with ZipFile(wheel, "w") as file:
        for name in ("featherfx/errors.py", "featherfx/_machine_code/../away.code"):
            file.writestr(name, "")
    with pytest.raises(SystemExit, match=r"a\.whl: holds no machine code"):
        ship.main(str(wheel))
    with ZipFile(wheel, "a") as file:
        for each in entries:
            file.write(each, f"featherfx/_machine_code/{each.parent.name}/{each.name}")
    ship.main(str(wheel))
    taken = {each.name: each.read_bytes() for each in (tmp_path / "new").rglob("*.code")}
    assert taken == {each.name: each.read_bytes() for each in entries}
