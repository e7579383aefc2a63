"""Contact asked for what cannot be, or of what is extreme: one message each, or an answer."""

from __future__ import annotations

import numpy as np
import pytest
from commands import invoke
from pxr import Usd, UsdGeom, Vt

from featherfx.baking.pipeline import bake
from featherfx.errors import InputWarning
from featherfx.shot.contact import settle

FEATHER = """[[feather]]
id = "{id}"
kind = "covert"
position = [0, {y}, {z}]
direction = [1, 0, 0]
up = [0, 0, 1]
stiffness = {stiffness}
"""
QUALITY = (
    '{ base = "draft", rows = 5, simulated_rows = 5, simulated_columns = 1, coefficients = 0 }'
)
PLATE = '[[collider]]\nusd = "plate.usda"\nprims = ["/plate"]\n'
# m, between the feathers of the stack; of the plate, at both frames: over it, and into it
STEP, HEIGHTS = 2e-4, (0.0125, 0.0095)
# factors of feathers, which multiply those of their overrides
STIFFNESS = {"f0": 10.0, "f1": 0.1}


def write(folder, feathers, quality=QUALITY, contact="", more=""):
    """A shot of feathers by id at (y, z)."""
    placed = [
        FEATHER.format(id=each, y=y, z=z, stiffness=STIFFNESS.get(each, 1.0))
        for each, (y, z) in feathers.items()
    ]
    (folder / "g.toml").write_text('name = "g"\n' + "".join(placed))
    text = f'name = "s"\ngroom = "g.toml"\nframes = [1, 2]\nquality = {quality}\n'
    (folder / "s.toml").write_text(f"{text}[contact]\n{contact}\n{more}")


@pytest.mark.parametrize(
    ("quality", "contact", "told"),
    [
        (
            "{ error = 50, rows = 1 }",
            "thickness = 0\nfriction = 10",
            {
                "quality.error: 50 is out of range. Give 0.01 to 20 %",
                "quality.rows: 1 is out of range. Give 3 to 400",
                "contact.thickness: 0 is out of range. Give 1e-06 to 0.1 m",
                "contact.friction: 10 is out of range. Give 0 to 2",
            },
        ),
        (
            "{ error = 1e-9 }",
            "thickness = 1",
            {
                "quality.error: 1e-09 is out of range. Give 0.01 to 20 %",
                "contact.thickness: 1 is out of range. Give 1e-06 to 0.1 m",
            },
        ),
        (
            '{ base = "draft", simulated_rows = 1 }',
            "",
            {"quality.simulated_rows: 1 is out of range. Give -1, 0, or 3 to 400"},
        ),
    ],
)
def test_what_cannot_be_is_one_message_each(tmp_path, quality, contact, told):
    write(tmp_path, {"a": (0.0, 0.0)}, quality, contact)
    result = invoke("bake", tmp_path / "s.toml", "-o", tmp_path / "s.usdc")
    assert result.exit_code == 1
    lines = result.stderr.splitlines()
    assert {line.partition("s.toml:")[2].partition(": ")[2].rstrip(".") for line in lines} == told
    assert not (tmp_path / "s.usdc").exists()


def test_fifty_that_a_plate_presses_and_two_in_one_place_are_solved(tmp_path, monkeypatch):
    """The lowest of the stack is a hundred million times as stiff as the next: steps of settling
    that failed twice are not tried again."""
    asked, take = [], settle._Steps.take

    def note(steps, states, length, *given):
        found = take(steps, states, length, *given)
        asked.append((length, float(found[2].max())))
        return found

    monkeypatch.setattr(settle._Steps, "take", note)
    stage = Usd.Stage.CreateNew(str(tmp_path / "plate.usda"))
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)
    plate = UsdGeom.Mesh.Define(stage, "/plate")
    points = np.array([[-1, -1, 0], [2, -1, 0], [2, 1, 0], [-1, 1, 0]], dtype=np.float32) / 10
    for frame, height in enumerate(HEIGHTS, 1):
        moved = points + np.float32([0.0, 0.0, height])
        plate.CreatePointsAttr().Set(Vt.Vec3fArray.FromNumpy(moved), frame)
    plate.CreateFaceVertexCountsAttr([4])
    plate.CreateFaceVertexIndicesAttr([0, 1, 2, 3])
    stage.SetTimeCodesPerSecond(24)
    stage.GetRootLayer().Save()
    feathers = {f"f{k}": (0.0, k * STEP) for k in range(50)} | {"a": (1.0, 0.0), "b": (1.0, 0.0)}
    stiff = [f"f{k} = {{ stiffness = {each} }}\n" for k, each in enumerate((1000, 0.001, 0.1))]
    write(tmp_path, feathers, more=PLATE + "[overrides]\n" + "".join(stiff))
    with pytest.warns(InputWarning, match="settle: feather"):
        report = bake(tmp_path / "s.toml", tmp_path / "s.usdc")
    _, failed, *_ = (k for k, (length, solved) in enumerate(asked) if solved < length)
    assert asked[failed + 1][0] == asked[failed][1]
    assert report["contact"]["most_contacts"] > 50
    assert report["contact"]["worst_depth"] < 1e-3
    assert not any("J/kg" in text for text in report["bounds_passed"])
