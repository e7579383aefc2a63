"""The gate for promised errors: the same shots for a seed, and a judgement that can fail."""

from featherfx.lab.bench import promise
from featherfx.lab.bench.promise import measure_promise, measure_promises, random_shot


def test_a_seed_draws_a_shot():
    first, again = (random_shot(4, ["covert", "down"]) for _ in range(2))
    assert first.inputs == again.inputs
    assert first.inputs != random_shot(5, ["covert", "down"]).inputs
    assert [random_shot(k, ["covert"]).contact is not None for k in range(3)] == [0, 0, 1]


def test_cases_are_kept_or_broken(monkeypatch):
    found = measure_promises(1, 1, lambda done, total: None)
    assert found["kept"] == 3
    assert {"promised", "reached"} <= found["cases"][0].keys()
    # a bake that errs by more than it says, beside a reference that agrees with its check
    monkeypatch.setattr(promise, "errors", lambda own, fine: [0.0 if own.options else 0.2])
    assert {each.outcome for each in measure_promise(1, ["covert"])} == {"broken"}
    # and beside one that does not
    monkeypatch.setattr(promise, "errors", lambda own, fine: [0.2])
    assert {each.outcome for each in measure_promise(1, ["covert"])} == {"undefined"}
