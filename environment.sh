# Sourced by .venv/bin/activate: makes the plain Dagster commands work from the repository root.
# TACTILE_HOME, TACTILE_PROFILE, TACTILE_STORE, TACTILE_SHAPENET and TACTILE_REAL are read where they
# are set and left unset otherwise. DAGSTER_HOME follows TACTILE_HOME.

# `dagster asset …` and `dagster job …` read neither pyproject.toml nor workspace.yaml: click takes `-m`
# from here.
# (DAGSTER_MODULE_NAME would do the same and make `dagster dev` hang.)
export DAGSTER_CLI_ASSET_MATERIALIZE_MODULE_NAME=tactile_assets.definitions
export DAGSTER_CLI_ASSET_LIST_MODULE_NAME=tactile_assets.definitions
export DAGSTER_CLI_JOB_EXECUTE_MODULE_NAME=tactile_assets.definitions
# The newer form, `dg launch --assets …`, serves as well; no need to hear of it each time.
export PYTHONWARNINGS="${PYTHONWARNINGS:+$PYTHONWARNINGS,}ignore:Function \`asset_materialize_command,ignore:Function \`job_execute_command"

_tactile_root="$(cd "$VIRTUAL_ENV/.." && pwd)"
if ! _tactile_home="$(PYTHONPATH="$_tactile_root" python -P -m tactile_core.home)"; then
    # It said why. Whatever is run now says so again and writes nothing: TACTILE_HOME stays as given.
    unset DAGSTER_HOME _tactile_root _tactile_home
    return 1
fi
if [ -n "${TACTILE_HOME:-}" ]; then
    export TACTILE_HOME="$_tactile_home"
fi
# A relative store would be another folder wherever a command is called: from here on it is one.
case "${TACTILE_STORE:-}" in
    "" | /* | "~"* | *://*) ;;
    *) export TACTILE_STORE="$PWD/$TACTILE_STORE" ;;
esac
export DAGSTER_HOME="$_tactile_home/dagster"
mkdir -p "$DAGSTER_HOME" || return 1
# A dagster.yaml or a link of your own in DAGSTER_HOME stays; a link to ours, of whichever checkout, or
# to nothing follows this checkout.
_tactile_link="$(readlink "$DAGSTER_HOME/dagster.yaml" || true)"
if [ ! -e "$DAGSTER_HOME/dagster.yaml" ] || { [ "${_tactile_link##*/}" = dagster.yaml ] \
    && (cd "$DAGSTER_HOME" && [ -d "${_tactile_link%/*}/tactile_assets" ]); }; then
    ln -sfn "$_tactile_root/dagster.yaml" "$DAGSTER_HOME/dagster.yaml"
fi

# Half of the processors to each process: steps run side by side, and two threads on two processors
# train nets three times slower than one as soon as anything else runs. Threads wait without spinning.
_tactile_processors="$(PYTHONPATH="$_tactile_root" python -P -m tactile_core.machine)"
export OMP_NUM_THREADS="${OMP_NUM_THREADS:-$(((_tactile_processors + 1) / 2))}"
export OMP_WAIT_POLICY="${OMP_WAIT_POLICY:-PASSIVE}"

# What runs on this machine stays on it.
export DAGSTER_DISABLE_TELEMETRY=yes
export RAY_USAGE_STATS_ENABLED=0
unset _tactile_root _tactile_home _tactile_link _tactile_processors
