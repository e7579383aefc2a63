"""The error that was promised and measured, in the report of a bake."""

from __future__ import annotations

from typing import Any

from featherfx.shot.loop.run import Stage


class ErrorStage(Stage):
    """Promised and measured error of the feathers that are simulated in full."""

    def report(self) -> dict[str, Any]:
        """Return error_promised and error_measured, percent of the length, None where none is;
        feathers that have no unique answer, ids by kind (undefined); kinds that cannot keep the
        error (over_promised)."""
        run, undefined = self.run, dict[str, list[str]]()
        options, placements = run.options, run.shot.groom.feathers
        several = {int(f) for g in run.groups for f in g.members[g.several]}
        worst = dict[str, float]()
        for f in sorted(int(f) for g in run.groups for f in g.members):
            placement = placements[f]
            measured = options.measured[f] if options.measured else None
            if f in several or (measured is not None and not measured.is_unique):
                undefined.setdefault(placement.kind.name, []).append(placement.id)
            elif measured is not None and options.feathers[f].level == "full":
                name = placement.kind.name
                worst[name] = max(worst.get(name, 0.0), 100.0 * measured.error)
        error = options.promised_error
        found: dict[str, Any] = {
            "error_promised": None if error is None else 100.0 * error,
            "error_measured": max(worst.values(), default=None),
            "undefined": undefined,
        }
        if error is None:
            return found | {"error_not_promised": options.why_not_promised}
        over = {k: each for k, each in worst.items() if each > 100.0 * error}
        return found | ({"over_promised": over} if over else {})
