"""The page that plays a cache: what is in it, and what a real browser makes of it."""

from __future__ import annotations

import http.client
import json
import re
import shutil
import subprocess
import threading
from pathlib import Path

import numpy as np
import pytest
from commands import invoke
from places import ROOT
from pxr import Sdf, Usd, UsdGeom

from featherfx.errors import InputError
from featherfx.render.geometry import load_points, load_scene
from featherfx.usd.read.cache import Cache
from featherfx.view.page import _HOST, Server, fitting, header_of, write_page
from featherfx.view.played import Played

BROWSER = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "chrome"))), None)
EVERYTHING = 1 << 40
SQUARE = ((-0.6, -0.6), (0.6, -0.6), (0.6, 0.6), (-0.6, 0.6))  # m, of a body
BROWSER_OPTIONS = (
    str(BROWSER),
    "--headless=new",
    "--no-sandbox",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--window-size=800,600",
)
needs_browser = pytest.mark.skipif(BROWSER is None, reason="no Chromium (Debian: chromium)")

# for scripts within the page: its canvas as pixels, and how far two pictures of it differ
PIXELS = """
  const wait = (ms) => new Promise((done) => setTimeout(done, ms));
  const over = () => window.featherfx?.ready || window.featherfx?.problem;
  for (let k = 0; k < 800 && !over(); k++) await wait(25);
  const f = window.featherfx;
  const canvas = document.querySelector("body > canvas");
  const copy = document.createElement("canvas");
  copy.width = canvas.width; copy.height = canvas.height;
  const paper = copy.getContext("2d");
  const shot = () => {
    paper.drawImage(canvas, 0, 0);
    return paper.getImageData(0, 0, copy.width, copy.height).data;
  };
  const differing = (one, other) => {
    let count = 0;
    for (let k = 0; k < one.length; k += 4)
      count += Math.abs(one[k] - other[k]) + Math.abs(one[k + 1] - other[k + 1]) > 12;
    return count / (one.length / 4);
  };
  const drawn = (one) => differing(one, one.map((_, k) => one[k % 4]));
"""

# what a page's user would do, by the names that the page gives to programs; it ends in the title
STEPS = f"""
(async () => {{
  {PIXELS}
  const told = {{ frames: f.frames, first: f.frame, ready: f.ready }};
  told.ids = f.feathers.map((each) => each.id);
  const before = shot();
  told.drawn = drawn(before);
  told.last = await f.setFrame(f.frames - 1);
  told.frame = f.frame;
  told.moved = differing(before, shot());
  await f.setColour("strain");
  told.strained = differing(before, shot());
  await f.setColour("velocity");
  told.coloured = differing(before, shot());
  for (let y = 40; y < innerHeight - 60 && !told.picked; y += 12)
    for (let x = 20; x < innerWidth && !told.picked; x += 12) told.picked = f.pick(x, y)?.id;
  told.panel = document.getElementById("picked").textContent;
  told.nothing = f.pick(1, innerHeight / 2);
  told.about = document.getElementById("about").textContent;
  told.beyond = await f.setFrame(1e9);
  await f.setColour("pattern");
  const play = document.getElementById("play"), all = f.triangles;
  f.spare = -1; // ms: no machine draws as fast
  f.few = 0;
  play.click();
  const least = f.header.levels.at(-1)[1];
  for (let k = 0; k < 100 && f.triangles > least; k++) await f.setFrame(k % f.frames);
  told.few = [f.triangles, document.getElementById("few").textContent];
  told.moving = drawn(shot());
  play.click();
  for (let k = 0; k < 400 && f.triangles !== all; k++) await wait(25);
  told.all = [f.triangles, document.getElementById("few").textContent];
  document.title = JSON.stringify(told);
}})();
"""

# the same of two caches
COMPARED = f"""
(async () => {{
  {PIXELS}
  const told = {{ ready: f.ready, names: document.getElementById("names").textContent }};
  const half = (k) => {{
    const found = [], all = shot();
    for (let y = 0; y < copy.height; y++)
      for (let x = k * copy.width / 2; x < (k + 1) * copy.width / 2; x++)
        found.push(...all.subarray(4 * (y * copy.width + x), 4 * (y * copy.width + x) + 4));
    return Uint8ClampedArray.from(found);
  }};
  told.same = differing(half(0), half(1));
  told.drawn = [drawn(half(0)), drawn(half(1))];
  await f.setFrame(4);
  told.other = differing(half(0), half(1));
  await f.setColour("difference");
  told.farthest = f.farthest;
  told.key = document.getElementById("key").textContent;
  told.whole = drawn(shot());
  await f.setFrame(0);
  told.nothing = f.farthest;
  document.title = JSON.stringify(told);
}})();
"""


# a body that is shown or not, and a camera that goes along or not
EMBODIED = f"""
(async () => {{
  {PIXELS}
  const told = {{ ready: f.ready }}, box = (id) => document.getElementById(id);
  const count = () => {{
    let found = 0;
    for (let y = 40; y < innerHeight - 60; y += 8)
      for (let x = 20; x < innerWidth; x += 8) found += f.pick(x, y) !== null;
    return found;
  }};
  const whole = shot();
  told.picked = count();
  box("body").click();
  told.body = differing(whole, shot());
  told.bare = count();
  box("home").click();
  await f.setFrame(4);
  const stays = shot();
  await f.setFrame(0);
  const before = shot();
  box("follow").click();
  await f.setFrame(4);
  told.follows = differing(stays, shot());
  await f.setFrame(0);
  told.back = differing(before, shot());
  document.title = JSON.stringify(told);
}})();
"""


def browse(address: str, folder: Path) -> str:
    """The page as it stands when it has come to rest."""
    done = subprocess.run(
        [
            *BROWSER_OPTIONS,
            "--virtual-time-budget=20000",
            f"--user-data-dir={folder / 'profile'}",
            "--dump-dom",
            address,
        ],
        capture_output=True,
        text=True,
        timeout=120,
    )
    return done.stdout


def result_of(text: str) -> dict:
    found = re.search(r"<title>(\{.*?\})</title>", text, re.S)
    assert found, text[-2000:]
    return json.loads(found[1].replace("&quot;", '"').replace("&amp;", "&"))


def with_steps(page: Path, steps: str = STEPS) -> Path:
    """A copy of a page that does steps; its policy lets scripts in by their nonce alone."""
    copy = page.with_name("steps.html")
    copy.write_text(scripted(page.read_text(), steps))
    return copy


def scripted(text: str, steps: str) -> str:
    nonce = re.search(r'<script nonce="([^"]+)"', text)[1]
    return text.replace("</body>", f'<script nonce="{nonce}">{steps}</script></body>')


@needs_browser
def test_a_file_plays_in_a_browser(cache, tmp_path):
    write_page([cache], tmp_path / "page.html", EVERYTHING, overwrite=False)
    told = result_of(browse(with_steps(tmp_path / "page.html").as_uri(), tmp_path))
    assert told["ready"] is True
    assert (told["frames"], told["first"], told["last"], told["frame"]) == (5, 0, 4, 4)
    assert told["beyond"] == 4
    assert told["ids"] == [each.id for each in Cache(cache).feathers]
    assert 0.01 < told["drawn"] < 0.9
    assert told["moved"] > 0.001
    assert told["coloured"] > told["moved"]
    assert told["strained"] > told["moved"]
    assert told["picked"] in told["ids"]
    assert told["panel"].startswith(told["picked"])
    assert told["nothing"] is None
    assert told["about"] == "4 feathers, 5 frames"
    # few triangles while it moves, where drawing is slow, and all where it stands
    (few, said), (every, nothing) = told["few"], told["all"]
    assert 0 < few < every
    assert said.startswith("drawn with half the resolution")
    assert f"and {few} of {every} triangles" in said
    assert nothing == ""
    assert told["moving"] > 0.01


# the picture in blocks of 8 by 8 pixels, each its mean
BLOCKS = f"""
(async () => {{
  {PIXELS}
  const all = shot(), told = [];
  for (let y = 40; y + 8 < copy.height - 48; y += 8)
    for (let x = 0; x + 8 < copy.width; x += 8) {{
      const sum = [0, 0, 0];
      for (let k = 0; k < 64; k++)
        for (let c = 0; c < 3; c++)
          sum[c] += all[4 * ((y + (k >> 3)) * copy.width + x + (k & 7)) + c] / 64;
      told.push(sum.map(Math.round));
    }}
  document.title = JSON.stringify({{ told }});
}})();
"""


@needs_browser
def test_the_processor_draws_what_a_card_does(cache, tmp_path):
    write_page([cache], tmp_path / "page.html", EVERYTHING, overwrite=False)
    page = with_steps(tmp_path / "page.html", BLOCKS).as_uri()
    pictures = [
        np.array(result_of(browse(page + end, tmp_path))["told"]) for end in ("#webgl", "#software")
    ]
    assert np.ptp(pictures[0], axis=0).min() > 30  # there is something in it
    assert np.abs(pictures[0] - pictures[1]).mean() < 1.0
    assert np.quantile(np.abs(pictures[0] - pictures[1]), 0.99) < 25  # edges are smooth in one


@needs_browser
def test_two_caches_stand_side_by_side_or_as_their_difference(cache, tmp_path):
    other, page = cache.with_name("others.usdc"), tmp_path / "page.html"
    command = ["view", str(cache), "--against", str(other), "--html", str(page)]
    result = invoke(*command)
    assert result.exit_code == 0, result.stderr
    told = result_of(browse(with_steps(page, COMPARED).as_uri(), tmp_path))
    assert told["ready"] is True
    assert told["names"] == "left: flaps.usdc, right: others.usdc"
    assert told["same"] < 0.002  # in one camera and frame
    assert min(told["drawn"]) > 0.01
    assert told["other"] > 0.002
    ends = [np.concatenate(Cache(each).points_of(range(4), 5.0)) for each in (cache, other)]
    apart = 1e3 * np.linalg.norm(ends[1] - ends[0], axis=1).max()
    assert told["farthest"] == pytest.approx(apart, rel=1e-2)
    assert "difference (mm)" in told["key"]
    assert told["whole"] > 0.01
    assert told["nothing"] == 0.0


def test_what_differs_in_feathers_has_no_difference(cache):
    both = header_of(Played(cache, EVERYTHING), Played(cache, 100))
    assert both["alike"] is False
    assert "no difference" in both["told"]


@needs_browser
def test_a_served_cache_is_shown_and_its_change_is_told(cache, tmp_path):
    copy = tmp_path / "copy.usdc"
    shutil.copyfile(cache, copy)
    with served(Played(copy, EVERYTHING)) as server:
        assert '<span id="number">frame 1</span>' in browse(server.address, tmp_path)
        copy.write_bytes(copy.read_bytes() + b" ")
        assert "has changed. Open it again" in browse(server.address, tmp_path)


def test_a_file_loads_nothing_else(cache, tmp_path):
    write_page([cache], tmp_path / "page.html", EVERYTHING, overwrite=False)
    text = (tmp_path / "page.html").read_text()
    policy = re.search(r'Content-Security-Policy" content="([^"]+)"', text)[1]
    assert "default-src 'none'" in policy
    assert "connect-src 'none'" in policy
    outside = re.sub(r"<script.*?</script>", "", text, flags=re.S)
    assert not re.search(r"""(?:src|href)\s*=|url\(|@import""", outside)
    assert all("src=" not in tag for tag in re.findall(r"<script[^>]*>", text))


def test_frames_hold_the_points_of_the_cache(cache):
    played, read = Played(cache, EVERYTHING), Cache(cache)
    header, frame = played.header(), played.frame(3)
    box = np.frombuffer(frame, "<f4", 6).astype(float)
    places = np.frombuffer(frame, "<u2", 3 * header["points"], 24).reshape(-1, 3)
    points = box[:3] + places / 65535 * box[3:]
    wanted = np.concatenate([read.points(k, 4.0) for k in range(len(read.feathers))])
    np.testing.assert_allclose(points, wanted, atol=box[3:].max() / 65535)
    corners = np.frombuffer(played.constant(), "<u4", 3 * header["triangles"])
    assert corners.max() == header["points"] - 1
    values = {each.name: played.value(each.name, 3) for each in played.values}
    assert len(frame) + sum(map(len, values.values())) == played.frame_bytes
    assert set(values["strain"]) <= {127, 128}  # they flap without a strain


@pytest.fixture
def embodied(cache, tmp_path) -> Path:
    """A copy of the cache that names a skin: an upright square through feathers, with points that
    no face has."""
    stage = Usd.Stage.CreateNew(str(tmp_path / "body.usda"))
    UsdGeom.SetStageUpAxis(stage, "Z")
    UsdGeom.SetStageMetersPerUnit(stage, 1)
    mesh = UsdGeom.Mesh.Define(stage, "/bird/body")
    mesh.CreateSubdivisionSchemeAttr("none")
    mesh.CreatePointsAttr([(0.05, y, z) for y, z in [*SQUARE, *[SQUARE[0]] * 100]])
    mesh.CreateFaceVertexCountsAttr([4])
    mesh.CreateFaceVertexIndicesAttr([0, 1, 2, 3])
    mesh.CreateDisplayColorAttr([(0.0, 0.0, 1.0)])
    stage.Save()
    copy = Sdf.Layer.CreateNew(str(tmp_path / "embodied.usdc"))
    copy.TransferContent(Sdf.Layer.FindOrOpen(str(cache)))
    told = dict(copy.customLayerData.get("featherfx", {}))
    skin = {"role": "skin", "file": "body.usda", "prim": "/bird/body", "start": 1.0, "first": 1.0}
    skin["time_codes_per_frame"] = 1.0
    copy.customLayerData = {"featherfx": told | {"scenery": {"0": skin}}}
    copy.Save()
    return tmp_path / "embodied.usdc"


def test_the_body_comes_with_the_feathers_and_what_passes_through_it_is_told(embodied):
    played = Played(embodied, EVERYTHING)
    assert played.header()["body"] == {"points": 104, "triangles": 2, "levels": [], "framed": 104}
    body = played.content("bodyconstant")
    assert sorted(np.frombuffer(body, "<u4", 6)) == [0, 0, 1, 2, 2, 3]
    assert len(body) == 24 + 3 * 104
    assert body[24:36] == bytes([0, 0, 255] * 4)  # of the corners; no face shows the others
    box = np.frombuffer(played.content("body-2"), "<f4", 6)
    np.testing.assert_allclose(box[:3] + box[3:], (0.05, 0.6, 0.6), atol=1e-6)
    found = np.frombuffer(played.content("penetration-0"), np.uint8)
    scene, points = load_scene(Cache(embodied)), load_points(Cache(embodied), played._scene, 1.0)
    beside = points[:, 0] > 0.05
    crossed = np.ptp(beside[scene.triangles].astype(int), axis=1) > 0
    wanted = np.zeros(len(points), dtype=int)
    wanted[scene.triangles[crossed & ~scene.rachis]] = 255
    assert 0 < wanted.sum() < 255 * len(points)
    np.testing.assert_array_equal(found, wanted)


def test_a_body_that_takes_too_much_is_left_out_and_told(embodied):
    whole = fitting(embodied, EVERYTHING)
    assert whole.body_bytes == len(whole.content("body-0"))
    bare = fitting(embodied, 5 * (2 * whole.body_bytes - 10))
    assert bare.told()[-1] == "without the body"
    assert bare.header()["body"] is None
    assert bare.content("body-0") is None
    some = fitting(embodied, 5 * (2 * whole.body_bytes + 100))
    assert some.points < whole.points
    assert some.body
    assert some.frame_bytes <= 2 * whole.body_bytes + 100


@needs_browser
def test_a_page_shows_the_body_and_goes_along(embodied, tmp_path):
    write_page([embodied], tmp_path / "page.html", EVERYTHING, overwrite=False)
    told = result_of(browse(with_steps(tmp_path / "page.html", EMBODIED).as_uri(), tmp_path))
    assert told["ready"] is True
    assert told["body"] > 0.02  # of the picture
    assert told["follows"] > 0.001
    assert told["back"] < 0.002
    # feathers behind the body cannot be picked
    assert told["bare"] > told["picked"] > 0


def served(played: Played):
    class Running:
        def __enter__(self):
            self.server = Server(played)
            self.thread = threading.Thread(target=self.server.serve_forever, daemon=True)
            self.thread.start()
            return self.server

        def __exit__(self, *_):
            self.server.shutdown()
            self.server.server_close()
            self.thread.join()

    return Running()


def ask(server: Server, path: str, **headers) -> tuple[int, bytes]:
    connection = http.client.HTTPConnection(_HOST, server.server_port, timeout=20)
    own = {"Host": f"{_HOST}:{server.server_port}", **headers}
    connection.request("GET", path, headers=own)
    answer = connection.getresponse()
    return answer.status, answer.read()


def test_only_who_has_the_token_and_asks_from_the_page_gets_anything(cache):
    with served(Played(cache, EVERYTHING)) as server:
        token = server.token
        assert server.server_address[0] == _HOST
        assert ask(server, f"/{token}/")[0] == 200
        assert ask(server, f"/{token}/frame-0") == (200, server.shown[0].frame(0))
        assert ask(server, f"/{token}/frame1-0") == (200, server.shown[0].frame(0, 1))
        assert ask(server, f"/{token}/strain-4") == (200, server.shown[0].value("strain", 4))
        own = f"http://{_HOST}:{server.server_port}"
        assert ask(server, f"/{token}/constant", Origin=own)[0] == 200
        for path in ("/", "/frame-0", f"/{token[:-1]}/", f"/{token}x/frame-0", "//", "/%2e%2e/"):
            assert ask(server, path)[0] == 404
        for name in (
            "frame-5",
            "frame--1",
            "frame9-0",
            "body-0",
            "bodyconstant",
            "strain1-0",
            "hooked-0",
            "second-frame-0",
            "../page.py",
            "..%2fpage.py",
            "/etc/passwd",
            "x",
        ):
            assert ask(server, f"/{token}/{name}")[0] == 404
        for headers in (
            {"Host": "evil.example"},
            {"Host": f"localhost.evil.example:{server.server_port}"},
            {"Origin": "https://evil.example"},
            {"Origin": "null"},
        ):
            status, content = ask(server, f"/{token}/", **headers)
            assert status == 403
            assert token.encode() not in content
        with pytest.raises(InputError, match=r"view: port: \d+ cannot be used: .*in use"):
            Server(*server.shown, port=server.server_port)


def test_the_command_writes_a_page_and_replaces_none(cache, tmp_path):
    page = tmp_path / "page.html"
    command = ["view", str(cache), "--html", str(page), "--megabytes", "0.1"]
    result = invoke(*command)
    assert result.exit_code == 0, result.stderr
    assert result.stdout == f"{page}\n"
    first = page.read_text()
    assert "without strain" in result.stderr
    assert 'id="data-strain-0"' not in first
    page.unlink()
    assert invoke(*command, "--value", "strain").exit_code == 0
    first = page.read_text()
    assert 'id="data-strain-0"' in first
    assert 'id="data-penetration-0"' not in first
    again = invoke(*command)
    assert again.exit_code == 1
    assert str(page) in again.stderr
    assert page.read_text() == first
    missing = invoke("view", tmp_path / "no.usdc", "--html", "x.html")
    assert missing.exit_code == 1
    assert len(missing.stderr.splitlines()) == 1


def test_grooms_are_shown_at_rest(tmp_path):
    page = tmp_path / "wing.html"
    groom = ROOT / "samples/breeze/groom.toml"
    result = invoke("view", groom, "--html", page)
    assert result.exit_code == 0, result.stderr
    assert '"frames":[null]' in page.read_text()
