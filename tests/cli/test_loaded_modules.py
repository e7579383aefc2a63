"""A command loads what its options ask for, and no other commands or features."""

import subprocess
import sys

from places import ROOT

SHOT = ROOT / "samples/feather_pull/shot.toml"
CODE = """
import sys
from featherfx.cli.main import main
try:
    main(sys.argv[1:], prog_name="featherfx")
finally:
    print(*sorted(name for name in sys.modules if name.startswith("featherfx.")), file=sys.stdout)
"""
# features of a bake that options ask for, and other commands
UNUSED = """
    baking.accuracy baking.trial baking.stats baking.reuse baking.shares baking.plan baking.install
    cli.farm cli.check cli.view cli.install cli.export cli.stats farm lab render trace view
"""


def loaded(*arguments: object) -> set[str]:
    command = [sys.executable, "-c", CODE, *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    return set(done.stdout.splitlines()[-1].split())


def test_a_plain_bake_loads_no_other_command_or_feature(tmp_path):
    modules = loaded("bake", SHOT, "-o", tmp_path / "pull.usdc", "--frames", "1-2")
    own = [each for each in modules if each.startswith(("featherfx.cli", "featherfx.baking"))]
    assert len(own) <= 16
    for name in UNUSED.split():
        prefix = f"featherfx.{name}"
        assert not [each for each in modules if f"{each}.".startswith(f"{prefix}.")], name


def test_resume_loads_what_it_needs(tmp_path):
    shown = ["bake", SHOT, "-o", tmp_path / "pull.usdc", "--frames", "1-2"]
    loaded(*shown)
    assert "featherfx.baking.reuse" in loaded(*shown, "--resume")
