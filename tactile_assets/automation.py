"""What runs by itself: weekly, when the source of the meshes changes, and after a training.

The schedule and the source sensor are off until they are switched on in the UI, under
Automation. Evaluations follow new policies, and that of the reconstruction a new U-Net, wherever
the daemon runs.
"""

import json
from datetime import UTC, datetime, timedelta

import dagster as dg

from tactile_assets.config import PROFILE, schedule_or_end
from tactile_assets.dagster_internals import longest_wait
from tactile_assets.jobs import EVALUATIONS, whole_chain
from tactile_assets.runs import end_dead_runs

EVERY_MONDAY_AT_THREE = "0 3 * * 1"
TEN_MINUTES = 600
HALF_A_MINUTE = 30

CRON = schedule_or_end()
# Promised only where somebody asked for a schedule: one run of the chain may take a day.
FRESHNESS = dg.FreshnessPolicy.time_window(longest_wait(CRON) + timedelta(days=1)) if CRON else None

# Whoever made a run that has not begun for so long was killed before it could.
LONGEST_START = timedelta(minutes=10)


def waiting(instance: dg.DagsterInstance) -> str:
    """That a run of the whole chain waits already, in a few words; "" where none does. It will read
    whatever there is once it begins: another behind it would find nothing new."""
    young = datetime.now(UTC) - LONGEST_START
    some = (
        dg.RunsFilter(job_name=whole_chain.name, statuses=[dg.DagsterRunStatus.QUEUED]),
        dg.RunsFilter(
            job_name=whole_chain.name,
            statuses=[dg.DagsterRunStatus.NOT_STARTED],
            created_after=young,
        ),
    )
    runs = [run for each in some for run in instance.get_runs(each, limit=1)]
    return f"run {runs[0].run_id} of the whole chain waits already" if runs else ""


def run_the_chain(context: dg.ScheduleEvaluationContext) -> dg.RunRequest | dg.SkipReason:
    """One run at a time waits for its turn."""
    if said := waiting(context.instance):
        return dg.SkipReason(said)
    return dg.RunRequest()


weekly = dg.schedule(
    name="weekly",
    job=whole_chain,
    cron_schedule=CRON or EVERY_MONDAY_AT_THREE,
    default_status=dg.DefaultScheduleStatus.STOPPED,
    description="Reruns the whole chain; TACTILE_CRON says when (UTC), in five cron fields.",
)(run_the_chain)


def look_for_changes(context: dg.SensorEvaluationContext) -> dg.SensorResult | dg.SkipReason:
    """The first look at a class only remembers what there is. Nothing is downloaded. A change is
    looked at twice, as what is being copied changes still.

    A server that cannot be asked fails the tick, which the UI shows. A source that has gone, such
    as a disk that is not mounted, is waited for: a run could not read it. An archive whose server
    does not tell its versions is named at every tick.
    """
    from tactile_core.dataset.sources.places import MissingClassError
    from tactile_core.dataset.sources.watching import source_fingerprint

    try:
        found = source_fingerprint(PROFILE.meshes)
    except MissingClassError as error:
        return dg.SkipReason(str(error))
    if not (found.versions or found.unwatched):
        return dg.SkipReason("meshes are generated: TACTILE_SHAPENET names no source to watch")
    for sentence in found.unwatched:
        context.log.warning(sentence)
    seen, new = versions_in(context.cursor)
    changed = {
        name: version
        for name, version in found.versions.items()
        if seen.get(name, version) != version
    }
    if changed and changed == new:
        if said := waiting(context.instance):
            return dg.SkipReason(said)
        request = dg.RunRequest(tags={"tactile/changed": ", ".join(changed)})
        return dg.SensorResult(run_requests=[request], cursor=cursor_of(seen | found.versions, {}))
    # What a server told before it fell silent is remembered: a run is for what it says then.
    cursor = cursor_of(seen | found.versions | {name: seen[name] for name in changed}, changed)
    if changed:
        said = f"{', '.join(changed)} changed; a run is asked for once it stays as it is"
    else:
        said = "the source has not changed" if seen else "the source is remembered"
    return dg.SensorResult(skip_reason="; ".join([said, *found.unwatched]), cursor=cursor)


source_changes = dg.sensor(
    name="source_changes",
    job=whole_chain,
    minimum_interval_seconds=TEN_MINUTES,
    default_status=dg.DefaultSensorStatus.STOPPED,
    description="Reruns the whole chain when the archives or folders of the meshes have changed.",
)(look_for_changes)


Versions = dict[str, str]  # by class


def cursor_of(seen: Versions, new: Versions) -> str:
    return json.dumps({"seen": seen, "new": new})


def versions_in(cursor: str | None) -> tuple[Versions, Versions]:
    """What `source_changes` has acted on, and what it has seen once that is new; nothing where
    there is no cursor of its kind."""
    try:
        found = json.loads(cursor or "{}")
        return dict(found["seen"]), dict(found["new"])
    except (ValueError, TypeError, KeyError):
        return {}, {}


@dg.sensor(
    minimum_interval_seconds=HALF_A_MINUTE,
    default_status=dg.DefaultSensorStatus.RUNNING,
    description="Marks runs as failed whose process was killed, so that the next ones may start.",
)
def dead_runs(context: dg.SensorEvaluationContext) -> dg.SkipReason:
    """Of runs on other machines nothing is known here."""
    return dg.SkipReason("; ".join(end_dead_runs(context.instance)) or "no run has died")


refresh_evaluations = dg.AutomationConditionSensorDefinition(
    "refresh_evaluations",
    target=EVALUATIONS,
    default_status=dg.DefaultSensorStatus.RUNNING,
    description="Evaluates anew when the policies have changed, or the U-Net.",
)


def after(*assets: str) -> dg.AutomationCondition:
    """Once more when one of these assets is new, and not for anything else upstream.

    New splits, for one, may hold in their test split models that the old policies were trained on.
    """
    newer = dg.AutomationCondition.any_deps_updated().allow(dg.AssetSelection.assets(*assets))
    return dg.AutomationCondition.eager().replace("any_deps_updated", newer)
