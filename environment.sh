# Sourced by .venv/bin/activate: makes the plain Dagster commands work from the repository root.
# TACTILE_HOME, TACTILE_PROFILE, TACTILE_STORE, TACTILE_SHAPENET and TACTILE_REAL are read where they
# are set and left unset otherwise; only TACTILE_HOME is made absolute, because DAGSTER_HOME must be.

_tactile_root="$(cd "$VIRTUAL_ENV/.." && pwd)"
if [ -n "${TACTILE_HOME:-}" ]; then
    mkdir -p "$TACTILE_HOME"
    TACTILE_HOME="$(cd "$TACTILE_HOME" && pwd)"
    export TACTILE_HOME
fi
DAGSTER_HOME="${TACTILE_HOME:-$_tactile_root/.tactile}/dagster"
export DAGSTER_HOME
mkdir -p "$DAGSTER_HOME"
# A dagster.yaml of your own in DAGSTER_HOME stays; a link to ours follows the checkout.
if [ -L "$DAGSTER_HOME/dagster.yaml" ] || [ ! -e "$DAGSTER_HOME/dagster.yaml" ]; then
    ln -sfn "$_tactile_root/dagster.yaml" "$DAGSTER_HOME/dagster.yaml"
fi

# `dagster asset …` reads neither pyproject.toml nor workspace.yaml: click takes `-m` from here.
# (DAGSTER_MODULE_NAME would do the same and make `dagster dev` hang.)
export DAGSTER_CLI_ASSET_MATERIALIZE_MODULE_NAME=tactile_assets.definitions
export DAGSTER_CLI_ASSET_LIST_MODULE_NAME=tactile_assets.definitions
# The newer form, `dg launch --assets …`, serves as well; no need to hear of it each time.
export PYTHONWARNINGS="${PYTHONWARNINGS:+$PYTHONWARNINGS,}ignore:Function \`asset_materialize_command"

# Half of the processors to each process: steps run side by side, and two threads on two processors
# train nets three times slower than one as soon as anything else runs. Threads wait without spinning.
export OMP_NUM_THREADS="${OMP_NUM_THREADS:-$((($(nproc) + 1) / 2))}"
export OMP_WAIT_POLICY="${OMP_WAIT_POLICY:-PASSIVE}"

# What runs on this machine stays on it; Ray writes no token into the user's home.
export DAGSTER_DISABLE_TELEMETRY=yes
export RAY_USAGE_STATS_ENABLED=0
export RAY_AUTH_MODE="${RAY_AUTH_MODE:-disabled}"
unset _tactile_root
