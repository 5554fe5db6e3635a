"""The whole platform on one page.

shapenet_meshes → masks → rotated_splits → outlines → tactile_samples
                               │               │            │
                               │               │      unet_search → unet → reconstruction_evaluation
                               └───────────────┴─────────────────────┤
                                                                 policies
                                                                     │
                                                                 rollouts
                                                                     │
                                             per_step_evaluation, per_grasp_evaluation

Where the profile practises, practice_rays stand between unet_search and unet, which reads them.
Where TACTILE_REAL names real meshes, both evaluations are made on those as well: real_shapes,
real_rollouts, real_per_step_evaluation, real_per_grasp_evaluation.
Where the profile has ideal observers and the meshes are generated, what can be attained is told:
believed_shapes, attainable_rollouts, attainable_evaluation.
"""

import dagster as dg

from tactile_assets import (
    attainable,
    automation,
    checks,
    console,
    dataset,
    evaluation,
    exploration,
    io_managers,
    jobs,
    notify,
    prune,
    real,
    reconstruction,
    runs,
)
from tactile_assets.config import PROFILE
from tactile_assets.dagster_internals import make_default_console
from tactile_assets.resources import Store
from tactile_core.machine import processors
from tactile_core.spread import on_cluster

STORE = Store.from_environment()
# A Ray cluster does their work, where there is one, and they only wait for it. Dagster would count
# the machine's processors, also those that are not for us.
AT_A_TIME = 16 if on_cluster() else processors()
# Small steps are over before a process has started; long ones run side by side, one a core.
STEPS = (
    dg.in_process_executor
    if PROFILE.name == "smoke" and not on_cluster()
    else dg.multiprocess_executor.configured(
        {
            "max_concurrent": AT_A_TIME,
            "start_method": {"forkserver": {"preload_modules": ["tactile_assets.preload"]}},
        }
    )
)

make_default_console(console.console)

ASSETS = [
    dataset.shapenet_meshes,
    dataset.masks,
    dataset.rotated_splits,
    dataset.outlines,
    dataset.tactile_samples,
    reconstruction.unet_search,
    *([reconstruction.practice_rays] if PROFILE.practice else []),
    reconstruction.unet,
    reconstruction.reconstruction_evaluation,
    exploration.policies,
    evaluation.rollouts,
    evaluation.per_step_evaluation,
    evaluation.per_grasp_evaluation,
    *(attainable.ASSETS if PROFILE.attainable else []),
    *(real.ASSETS if PROFILE.real else []),
]

defs = dg.Definitions(
    assets=dg.with_source_code_references(ASSETS),
    asset_checks=[
        *dg.load_asset_checks_from_package_module(checks),
        *(real.CHECKS if PROFILE.real else []),
    ],
    jobs=[*jobs.JOBS, prune.prune_job],
    schedules=[automation.weekly],
    sensors=[
        automation.source_changes,
        automation.refresh_evaluations,
        automation.dead_runs,
        notify.failed_runs,
        notify.failed_checks,
        notify.messages,
    ],
    resources={
        "store": STORE,
        **io_managers.IO_MANAGERS,
    },
    executor=runs.one_at_a_time(STEPS, STORE),
    loggers={"console": console.console},
)
