"""Each training is a step of its own: tried again where that may help, refused where it cannot."""

import dagster as dg
import pytest

from tactile_assets import exploration
from tactile_core.errors import TactileError
from tactile_core.exploration import training as core

ONE = {
    "ops": {"policies": {"config": {"approaches": ["total"], "seeds": [3], "steps_per_stage": 256}}}
}


@pytest.fixture
def failing(monkeypatch):
    """Lets the first call of the core's training fail with the error that a test names."""
    train, calls = core.train_policy, []

    def train_policy(*arguments, **named):
        calls.append(arguments)
        if len(calls) == 1:
            raise failing.error
        return train(*arguments, **named)

    failing = train_policy
    monkeypatch.setattr(core, "train_policy", train_policy)
    return train_policy


def retries(result: dg.ExecuteInProcessResult) -> list[str | None]:
    kind = dg.DagsterEventType.STEP_UP_FOR_RETRY
    return [event.step_key for event in result.all_events if event.event_type == kind]


def test_a_training_that_breaks_off_is_tried_again_on_its_own(copy_of_chain, failing):
    failing.error = OSError("the disk was away")
    result = copy_of_chain.materialise("policies", config=ONE)
    assert result.success
    # What its steps handed each other lies in the store, where other machines could read it.
    assert list(copy_of_chain.store.path("steps", result.run_id).rglob("total_3"))
    assert retries(result) == ["policies.train_policy[total_3]"]


def test_a_training_that_a_user_has_to_mend_is_not_tried_again(copy_of_chain, failing):
    failing.error = TactileError("batch_size is too large: choose a smaller one")
    with pytest.raises(dg.Failure, match="batch_size is too large"):
        copy_of_chain.materialise("policies", config=ONE)
    assert not copy_of_chain.store.path("policies", "total-3").exists()


def test_approaches_and_seeds_named_twice_are_trained_once():
    config = exploration.PolicyConfig(approaches=["total", "total"], seeds=[0, 1, 0])
    planned = [output.value.name for output in exploration.plan_trainings(config)]
    assert planned == ["total-0", "total-1"]
