"""Trial kernels that other processes compile and load."""

import pytest
from kernel_runs import run_in


@pytest.fixture
def run_kernels(tmp_path):
    """As run_in, with a cache beside; stderr of the last run is its attribute."""

    def run(folder, module="trial_types", before="", **variables):
        cache = {"FEATHERFX_CACHE": str(tmp_path / "cache"), "HOME": str(tmp_path / "home")}
        found, run.stderr = run_in(folder, module, before, cache | variables)
        return found

    return run


@pytest.fixture(scope="session")
def compiled_once(tmp_path_factory):
    """What the first run printed, and the cache that it left."""
    folder = tmp_path_factory.mktemp("first")
    cache = {"FEATHERFX_CACHE": str(folder / "cache")}
    return run_in(folder / "here", "trial_types", "", cache)[0], folder / "cache"
