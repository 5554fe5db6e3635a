"""No evaluation meets what its nets were trained on, however the tables came together."""

import dagster as dg
import pytest

from tests.assets.running import run_for


def reasons(result: dg.ExecuteInProcessResult) -> list[str]:
    """Why steps failed."""
    return [
        event.step_failure_data.error.cause.message
        if event.step_failure_data.error.cause
        else event.step_failure_data.error.message
        for event in result.all_events
        if event.event_type == dg.DagsterEventType.STEP_FAILURE
    ]


@pytest.mark.parametrize("asset", ["rollouts", "reconstruction_evaluation"])
def test_splits_dealt_anew_are_not_evaluated_by_old_nets(copy_of_chain, asset):
    dealt = ("rotated_splits", "outlines", "tactile_samples")
    anew = run_for(dealt, rotated_splits={"seed": 5})
    copy_of_chain.materialise(*dealt, config=anew)
    result = copy_of_chain.materialise(asset, raise_on_error=False)
    [reason] = reasons(result)
    assert "models to test on were trained on by" in reason
    assert "materialise unet" in reason


def test_new_masks_under_old_outlines_are_refused(copy_of_chain):
    other_angles = run_for(("rotated_splits",), rotated_splits={"seed": 5})
    copy_of_chain.materialise("rotated_splits", config=other_angles)
    result = copy_of_chain.materialise("unet", raise_on_error=False)
    [reason] = reasons(result)
    assert "outlines are those of other masks" in reason
