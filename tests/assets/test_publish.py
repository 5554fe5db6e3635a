import json

import pytest

from tactile_assets.publish import BEGIN, END, README, RESULTS, readme_results, with_results
from tactile_core.errors import TactileError


def test_the_readmes_results_are_those_of_the_published_run():
    assert with_results(README.read_text(), readme_results()) == README.read_text(), (
        "run: python -m tactile_assets.publish"
    )


def test_every_published_run_says_how_it_was_made():
    runs = sorted(RESULTS.glob("*/run.json"))
    assert runs
    for run in runs:
        about = json.loads(run.read_text())
        assert {"command", "commit", "machine", "started", "minutes", "seeds"} <= about.keys()
        assert "dirty" not in about["commit"]


def test_a_readme_without_marks_is_refused():
    with pytest.raises(TactileError, match="lacks the marks"):
        with_results("# Readme", "results")
    assert with_results(f"a {BEGIN} old {END} z", "new") == f"a {BEGIN}\n\nnew\n\n{END} z"
