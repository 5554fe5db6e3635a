"""Kill -9 in the middle of things; `make chaos` does so at random moments of the whole chain."""

import re

from tests.chaos import begin_chain, data_versions, left_behind, run_to_its_end

ASSETS = [
    "shapenet_meshes",
    "masks",
    "rotated_splits",
    "outlines",
    "tactile_samples",
    "unet_search",
]


def kill_when(said: str, home) -> None:
    """Begin a run and kill it when its console says so."""
    with begin_chain(home, ASSETS) as run:
        assert run.stderr is not None
        assert any(re.search(said, line) for line in run.stderr)
        run.kill()


def test_a_run_that_was_killed_twice_ends_as_one_that_was_not_and_leaves_nothing(chain, tmp_path):
    home = tmp_path / "home"
    kill_when("masks .* rendering", home)
    kill_when("unet_search .* started", home)
    run_to_its_end(home, ASSETS)
    assert data_versions(home, ASSETS) == chain.data_versions(ASSETS)
    assert left_behind(home) == []
