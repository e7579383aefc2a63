"""Each page for readers runs in one folder, as it stands."""

import pytest
from page_runs import pages_with_commands, prepare, run_page


@pytest.fixture(scope="module")
def inputs(tmp_path_factory):
    folder = tmp_path_factory.mktemp("inputs") / "of_pages"
    prepare(folder)
    return folder


@pytest.mark.nightly
@pytest.mark.parametrize("page", list(pages_with_commands()))
def test_a_page_runs_in_one_folder(page, inputs, tmp_path):
    """All but installing and other programs, with what the commands print."""
    run_page(page, tmp_path, inputs)
