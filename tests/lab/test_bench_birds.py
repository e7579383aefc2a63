"""Whole birds at each quality beside a fine reference."""

from __future__ import annotations

from featherfx.lab.bench import skips

TINY = skips.BirdExtent(frames=2, feathers=12, qualities=("draft", 0.5), swan=300)


def test_finer_qualities_come_nearer_to_the_reference(monkeypatch):
    monkeypatch.setattr(skips, "SCENES", {"swan layered": None})
    told = []
    rows = skips.measure_birds(TINY, lambda done, total: told.append((done, total)))
    assert told == [(1, 2), (2, 2)]
    assert [row["quality"] for row in rows] == ["draft", "0.5 %"]
    assert set(rows[0]) == {
        *("scene", "quality", "error", "cpu_seconds", "wall_seconds", "peak_memory_bytes")
    }
    draft, fine = rows
    assert 0.0 < fine["error"] < draft["error"] < 20.0
    for row in rows:
        assert row["cpu_seconds"] > 0.0
        assert 5e7 < row["peak_memory_bytes"] < 4e9
