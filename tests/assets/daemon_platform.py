"""What a real daemon runs in the tests: schedule, sensors and the first asset as they are.

The sources are the test's own and are looked at more often; in place of the evaluations stand two
that compute nothing.
"""

import json
import os

import dagster as dg

from tactile_assets import config

_meshes = config.PROFILE.meshes.model_copy(
    update={"classes": json.loads(os.environ["TEST_CLASSES"])}
)
config.PROFILE = config.PROFILE.model_copy(update={"meshes": _meshes})

from tactile_assets import automation, dataset, io_managers, notify, runs  # noqa: E402
from tactile_assets.definitions import STORE  # noqa: E402


@dg.asset(
    deps=["policies"], group_name="evaluation", automation_condition=automation.after("policies")
)
def rollouts() -> None:
    pass


@dg.asset(automation_condition=automation.after("unet"))
def reconstruction_evaluation() -> None:
    pass


defs = dg.Definitions(
    assets=[dataset.shapenet_meshes, rollouts, reconstruction_evaluation, dg.AssetSpec("policies")],
    jobs=[automation.whole_chain],
    schedules=[
        dg.schedule(
            name=automation.weekly.name,
            job=automation.whole_chain,
            cron_schedule=automation.weekly.cron_schedule,
            default_status=dg.DefaultScheduleStatus.RUNNING,
        )(automation.run_the_chain)
    ],
    sensors=[
        dg.sensor(
            name="source_changes",
            job=automation.whole_chain,
            minimum_interval_seconds=1,
            default_status=dg.DefaultSensorStatus.RUNNING,
        )(automation.look_for_changes),
        automation.refresh_evaluations,
        automation.dead_runs,
        notify.failed_runs,
        notify.failed_checks,
        notify.messages,
    ],
    resources={"store": STORE, **io_managers.IO_MANAGERS},
    executor=runs.one_at_a_time(dg.in_process_executor, STORE),
)
