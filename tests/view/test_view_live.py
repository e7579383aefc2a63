"""Presets that are changed while feathers are simulated: values, files, states, and the page."""

from __future__ import annotations

import http.client
import json
import struct
import subprocess
import threading
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from commands import invoke
from places import ROOT
from test_view_page import BROWSER_OPTIONS, PIXELS, needs_browser, scripted

from featherfx.api import read_quality, read_shot
from featherfx.cli.view import _OF_WING, _stage
from featherfx.errors import InputError
from featherfx.feather.placed_feathers import build_feathers
from featherfx.groom.presets.library import plain
from featherfx.groom.presets.presets import load_preset
from featherfx.shot.loop.live import JoinedSurfaces, LiveSimulation
from featherfx.view.live import Live, LiveServer, LiveSource, presets_of
from featherfx.view.page import _HOST
from featherfx.view.tuned import Tuned

SHOT = ROOT / "samples/feather_pull/shot.toml"
ANGLE = "feather/swan_primary:leading.guides.1.angle"
YOUNG = "feather/swan_primary:rachis_material.youngs_modulus"
HOOKS = "feather/swan_primary:vane_material.hooks"
SPEED = "wind/calm:speed"
YOUNG_OF_PRIMARY = "feather/primary:rachis_material.youngs_modulus"


def test_sliders_are_the_declared_keys():
    tuned = Tuned([("feather", "swan_primary"), ("wind", "breeze"), ("motion", "flap")], [])
    sliders = {each.key.partition(":")[2]: each for each in tuned.sliders}
    young, angle = sliders["rachis_material.youngs_modulus"], sliders["trailing.guides.0.angle"]
    assert (young.unit, young.low, young.high) == ("Pa", 1e3, 1e12)
    assert (angle.unit, angle.low, angle.high, angle.value) == ("deg", 5.0, 120.0, 65.0)
    assert sliders["vane_material.hooks"].choices == ("closed", "slip", "open")
    assert {
        "speed",
        "gust",
        "direction.2",
        "wingbeat_frequency",
        "wrist.harmonics.0.1",
    } <= sliders.keys()
    for each in tuned.sliders:
        if each.kind in ("number", "whole"):
            assert each.low <= each.near[0] < each.near[1] <= each.high, each
            assert each.near[0] <= each.value <= each.near[1], each
            assert each.scale != "factor" or each.near[0] > 0.0


def test_files_hold_what_was_changed_and_nothing_else(tmp_path):
    tuned = Tuned([("feather", "swan_primary"), ("wind", "breeze")], [])
    assert tuned.files() == {}
    with pytest.raises(InputError, match="nothing was changed"):
        tuned.write(tmp_path, overwrite=False)
    tuned.change(ANGLE, 20)
    tuned.change(YOUNG, 3e9)
    tuned.change("wind/breeze:speed", 7.5)
    tuned.change("wind/breeze:speed", 3.0)  # as it was
    assert [*tuned.files()] == ["feather/swan_primary.toml"]
    (path,) = tuned.write(tmp_path, overwrite=False)
    before, after = (plain(load_preset("swan_primary", each)[1]) for each in ([], [tmp_path]))
    assert after["rachis_material"].pop("youngs_modulus") == 3e9
    del before["rachis_material"]["youngs_modulus"]
    angles = [each["angle"] for each in after["leading"].pop("guides")]
    assert angles == [45.0, 20.0, 27.0, 22.0]
    del before["leading"]["guides"]
    assert after == before
    text = path.read_text()
    with pytest.raises(InputError, match=r"swan_primary\.toml: exists. --overwrite"):
        tuned.write(tmp_path, overwrite=False)
    again = Tuned([("feather", "swan_primary")], [tmp_path])
    again.change(YOUNG, 4e9)
    with pytest.raises(InputError, match="is what these changes are to"):
        again.write(tmp_path, overwrite=True)
    assert path.read_text() == text


@pytest.mark.parametrize(
    ("key", "value", "told"),
    [
        (YOUNG, -1.0, "-1 is out of range. Give 1000 to 1e\\+12 Pa"),
        (YOUNG, "soft", "'soft' is not a number"),
        (YOUNG, float("nan"), "nan is not a finite number"),
        (HOOKS, "torn", "'torn' is not allowed"),
        ("feather/swan_primary:colour.base.0", 0.5, "cannot be changed here"),
        ("../../etc/passwd:x", 1.0, "cannot be changed here"),
    ],
)
def test_what_is_not_allowed_changes_nothing(key, value, told):
    tuned = Tuned([("feather", "swan_primary")], [])
    with pytest.raises(InputError, match=told):
        tuned.change(key, value)
    assert tuned.files() == {}


def changed(shot, **values):
    feather = shot.groom.feathers[0]
    kind = replace(feather.kind, **values)
    feathers = (replace(feather, kind=kind, prototype=None), *shot.groom.feathers[1:])
    return replace(shot, groom=replace(shot.groom, feathers=feathers))


def test_a_feather_goes_on_from_where_it_was_in_another_shape():
    shot = read_shot(SHOT)
    quality = replace(read_quality("draft").pushing, simulated_rows=0)
    shot = changed(replace(shot, quality=quality))
    first = LiveSimulation(shot, 1, (1, 100))
    frames = iter(first)
    for _ in range(6):
        next(frames)
    before = first.checkpoint().states[0].points.at(0)
    kind = shot.groom.feathers[0].kind
    stiff = changed(shot, rachis_material=replace(kind.rachis_material, youngs_modulus=4e9))
    other = LiveSimulation(stiff, 1, (1, 100))
    assert other.reshaped(first)
    state = other.checkpoint()
    np.testing.assert_array_equal(state.states[0].points.nodes[0], before.nodes)
    assert state.index == 5
    longer = LiveSimulation(changed(shot, length=1.2 * kind.length), 1, (1, 100))
    assert longer.reshaped(first)
    state = longer.checkpoint().states[0]
    shaft, was = state.points.nodes[0, :, 0], before.nodes[:, 0]
    steps = [np.linalg.norm(np.diff(each, axis=0), axis=1) for each in (shaft, was)]
    np.testing.assert_allclose(steps[0], 1.2 * steps[1], rtol=1e-3)
    np.testing.assert_array_equal(shaft[0], was[0])
    # as bent as before, only longer
    np.testing.assert_allclose(shaft[-1] - shaft[0], 1.2 * (was[-1] - was[0]), atol=2e-3)
    assert next(iter(longer)).number == 7
    finer = replace(shot, quality=replace(shot.quality, rows=14))
    assert not LiveSimulation(finer, 1, (1, 100)).reshaped(first)


def test_meshes_of_all_feathers_are_those_of_each():
    shot = read_shot(SHOT)
    feathers = build_feathers([*shot.groom.feathers, *shot.groom.feathers], 9, 3)
    feathers += build_feathers(shot.groom.feathers, 12, 4)
    poses = [each.rest.shifted(np.array([0.0, 0.1, k])) for k, each in enumerate(feathers)]
    expected = [f.surface.points(pose) for f, pose in zip(feathers, poses, strict=True)]
    np.testing.assert_allclose(
        JoinedSurfaces(feathers).points(poses), np.concatenate(expected), rtol=0, atol=1e-12
    )


@pytest.fixture(scope="module")
def live(tmp_path_factory):
    source = LiveSource(SHOT, tmp_path_factory.mktemp("live"))
    with Live(source, presets_of(source)) as live:
        yield live


def told_of(content: bytes) -> dict:
    (size,) = struct.unpack_from("<I", content)
    return json.loads(content[4 : 4 + size])


def until(live, fits, most=400):
    """What is told with the first frame that fits."""
    told = told_of(live.after(0))
    for _ in range(most):
        if fits(told):
            return told
        told = told_of(live.after(told["number"]))
    raise AssertionError(told)


def test_frames_follow_each_other_and_feel_what_is_done(live):
    told = until(live, lambda told: told["time"] > 0.1)
    assert told["energy"].keys() == {"kinetic", "elastic", "height"}
    assert told["problem"] == ""
    size = len(live.after(0)) - 4 - struct.unpack_from("<I", live.after(0))[0]
    assert size == 24 + 6 * live.played.points
    assert len(live.after(0, "strain")) - len(live.after(0)) == pytest.approx(size / 6 - 4, abs=40)
    # a breath from below lifts what lies still
    assert until(live, lambda told: told["time"] > 2.0)["energy"]["kinetic"] < 1e-9
    live.blow([0.0, 0.0, 2.0], 12.0)
    until(live, lambda told: told["energy"]["kinetic"] > 1e-6)
    live.blow(None, 0.0)
    with pytest.raises(InputError, match="speed: 1000 is out of range"):
        live.blow([0.0, 0.0, 1.0], 1000.0)


def test_a_hand_leads_the_nearest_place(live):
    nodes = live._frame.poses[0].points.nodes
    at = nodes[-3, 0]
    live.pull(0, (at + 1e-4).tolist(), (at + np.array([0.0, 0.0, 0.02])).tolist())
    grip, to = live._pull
    assert (grip.feather, grip.column) == ("feather", 0.0)
    assert grip.row == pytest.approx((len(nodes) - 3) / (len(nodes) - 1))
    far = until(live, lambda _: live._frame.poses[0].points.nodes[-3, 0, 2] > at[2] + 0.005)
    assert far["problem"] == ""
    live.pull(0, [0, 0, 0], (to + np.array([0.0, 0.01, 0.0])).tolist())
    assert live._pull[0] is grip  # the hand goes on with what it holds
    live.pull(None, None, None)
    for wrong in ([1.0, 2.0], ["a", 0, 0], [np.inf, 0, 0]):
        with pytest.raises(ValueError, match=r"array|float|\["):
            live.pull(0, [0, 0, 0], wrong)


def test_changes_are_simulated_and_what_is_wrong_is_told(live):
    before = until(live, lambda told: True)
    live.change(YOUNG, 5e9)
    until(
        live, lambda _: live._made.shot.groom.feathers[0].kind.rachis_material.youngs_modulus == 5e9
    )
    assert live._frame.time >= before["time"]
    live.change("feather/swan_primary:leading.guides.1.position", 0.9)  # beyond the next one
    told = until(live, lambda told: told["problem"])
    assert "position" in told["problem"]
    live.change("feather/swan_primary:leading.guides.1.position", 0.25)
    until(live, lambda told: not told["problem"])
    live.restart()
    assert until(live, lambda told: told["time"] < 0.5)["frame"] < 13


def test_a_wing_begins_again_with_other_bones(tmp_path):
    shot, family = _stage("wing/pigeon", tmp_path, [], "calm", "hold")
    source = LiveSource(shot, tmp_path, [_OF_WING])
    tuned = presets_of(source)
    assert family == "wing"
    assert {"wing/pigeon:humerus", "wing/pigeon:primaries.lengths.3", YOUNG_OF_PRIMARY} <= {
        each.key for each in tuned.sliders
    }
    with Live(source, tuned) as live:
        assert len(live.header()["feathers"]) == 10
        before = until(live, lambda told: told["frame"] > 3)
        root = live._frame.poses[0].points.nodes[0, 0]
        live.change(YOUNG_OF_PRIMARY, 4e9)  # which moves no root: it goes on
        young = lambda: live._made.shot.groom.feathers[0].kind.rachis_material.youngs_modulus  # noqa: E731
        assert until(live, lambda _: young() == 4e9)["frame"] > before["frame"]
        live.change("wing/pigeon:humerus", 0.055)  # 45 mm before
        moved = lambda: np.linalg.norm(live._frame.poses[0].points.nodes[0, 0] - root)  # noqa: E731
        told = until(live, lambda _: moved() > 0.005)
        assert told["problem"] == ""
        assert moved() == pytest.approx(0.01, abs=1e-4)


@contextmanager
def served(server):
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()
    try:
        yield server
    finally:
        server.shutdown()
        server.server_close()
        thread.join()


def post(server, name, content, own_origin=True, **headers):
    own = f"{_HOST}:{server.server_port}"
    connection = http.client.HTTPConnection(_HOST, server.server_port, timeout=20)
    origin = {"Origin": f"http://{own}"} if own_origin else {}
    connection.request("POST", name, body=content, headers={"Host": own, **origin, **headers})
    answer = connection.getresponse()
    return answer.status, answer.read().decode()


def test_only_its_own_page_may_say_something(live, tmp_path):
    with served(LiveServer(live, tmp_path, overwrite=False)) as server:
        own, change = f"/{server.token}/", json.dumps({"key": YOUNG, "value": 2e9})
        assert post(server, f"{own}change", change)[0] == 200
        assert post(server, f"{own}change", change, own_origin=False)[0] == 403
        for headers in ({"Origin": "https://evil.example"}, {"Host": "evil.example"}):
            assert post(server, f"{own}change", change, **headers)[0] == 403
        assert post(server, "/x/change", change)[0] == 404
        assert post(server, f"{own}delete", "{}")[0] == 404
        assert post(server, f"{own}change", "x" * 70_000)[0] == 413
        for wrong in ("", "[]", "{}", '{"key": 3}', "nonsense"):
            assert post(server, f"{own}change", wrong)[0] in (400, 409), wrong
        status, text = post(server, f"{own}change", json.dumps({"key": YOUNG, "value": 1}))
        assert (status, "out of range" in text) == (409, True)
        status, text = post(server, f"{own}save", "{}")
        assert status == 200
        (path,) = json.loads(text)["written"]
        assert Path(path) == tmp_path / "feather/swan_primary.toml"
        assert (
            Path(path).read_text()
            == 'base = "swan_primary"\nrachis_material.youngs_modulus = 2000000000\n'
        )
        assert post(server, f"{own}save", "{}")[0] == 409


# what a page's user would do; the result is posted
STEPS = f"""
(async () => {{
  {PIXELS}
  const said = {{ problem: f.problem }};
  const reach = async (fits) => {{
    for (let k = 0; k < 800 && !fits(); k++) await wait(25);
    return fits();
  }};
  said.updated = await reach(() => f.updates > 20);
  await reach(() => f.live.time > 1.5 && f.live.energy.kinetic < 1e-9);
  const still = shot();
  said.drawn = drawn(still);
  const line = document.querySelector('label[data-key$=":rachis.sweep"]');
  const way = line.querySelector("input[type=range]");
  way.value = 620;
  way.dispatchEvent(new Event("input"));
  said.number = Number(line.querySelector("input[type=number]").value);
  said.moved = await reach(() => differing(still, shot()) > 0.01);
  await reach(() => f.rate > 0);
  said.numbers = document.getElementById("numbers").textContent;
  said.written = (await f.save()).length;
  await fetch("said", {{ method: "POST", body: JSON.stringify(said) }});
}})();
"""


class Watched(LiveServer):
    """Its page does STEPS."""

    said = None

    def content(self, name):
        found = super().content(name)
        return (found[0], scripted(found[1].decode(), STEPS).encode()) if name == "" else found

    def posted(self, name, content):
        if name != "said":
            return super().posted(name, content)
        self.said = content
        self.done.set()
        return {}


@needs_browser
def test_a_slider_of_the_page_changes_the_feather(live, tmp_path):
    live.restart()
    server = Watched(live, tmp_path / "saved", overwrite=False)
    server.done = threading.Event()
    command = [*BROWSER_OPTIONS, f"--user-data-dir={tmp_path / 'profile'}", server.address]
    with served(server), subprocess.Popen(command, stdout=-3, stderr=-3) as browser:
        try:
            assert server.done.wait(90.0)
        finally:
            browser.terminate()
    said = server.said
    assert said["problem"] == ""
    assert said["updated"] is True
    assert 0.01 < said["drawn"] < 0.9
    assert said["number"] == pytest.approx(0.62 * 360 - 180, abs=0.5)
    assert said["moved"] is True
    assert "updates a second" in said["numbers"]
    assert said["written"] == 1
    text = (tmp_path / "saved/feather/swan_primary.toml").read_text()
    assert f"rachis.sweep = {said['number']:g}" in text


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["no_such"], "there is no such preset"),
        (["quality/draft"], "is a quality preset. Give one of feather"),
        (["bird/pigeon"], "A bird needs a body, so give a shot"),
        (["missing.toml"], "there is no such file"),
        ([str(SHOT), "--feather", "x*"], "0 feathers are not allowed. Give 1 to 5000"),
    ],
)
def test_what_cannot_be_tuned_is_told_in_a_line(words, told):
    result = invoke("tune", *words, "--no-browser")
    assert result.exit_code == 1
    assert len(result.stderr.splitlines()) == 1
    assert told in result.stderr
