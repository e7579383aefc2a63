"""The process that workers of this machine are forked from."""

from __future__ import annotations

import json
import subprocess
import sys

import pytest

pytest.importorskip("distributed")

SCRIPT = """
import json, multiprocessing, os, signal, sys
from featherfx.farm import origin

def told(pipe):
    pipe.send({
        "loaded": {"distributed", "featherfx.farm.work"} <= sys.modules.keys(),
        "interrupts ignored": signal.getsignal(signal.SIGINT) == signal.SIG_IGN,
        "threads it was forked beside": len(os.listdir(f"/proc/{os.getppid()}/task")),
        "threads of BLAS": os.environ.get("OMP_NUM_THREADS"),
    })

if __name__ == "__main__":
    origin.begin()
    with origin.forked():
        from distributed.utils import get_mp_context
        way = get_mp_context()
    here, there = way.Pipe()
    process = way.Process(target=told, args=(there,))
    process.start()
    print(json.dumps(here.recv() | {"way": way.get_start_method(), "mine": dict(os.environ)}))
    process.join()
"""


@pytest.mark.skipif(sys.platform != "linux", reason="looks at threads in /proc")
def test_workers_are_forked_from_a_process_that_has_loaded_all_and_has_no_threads(
    tmp_path, monkeypatch
):
    monkeypatch.delenv("OMP_NUM_THREADS", raising=False)
    script = tmp_path / "script.py"
    script.write_text(SCRIPT)
    ran = subprocess.run([sys.executable, script], capture_output=True, text=True, check=True)
    found = json.loads(ran.stdout)
    assert "OMP_NUM_THREADS" not in found.pop("mine")
    assert found == {
        "loaded": True,
        "interrupts ignored": True,
        "threads it was forked beside": 1,
        "threads of BLAS": "1",
        "way": "forkserver",
    }
    assert ran.stderr == ""
