"""Ways to run the platform: with the plain commands, and in this process."""

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import dagster as dg

from tactile_assets.chain import in_order
from tactile_assets.definitions import defs
from tactile_assets.paths import REPOSITORY
from tactile_assets.resources import Store

# Smaller even than the smoke profile, where only the way through matters.
TINY = {
    "shapenet_meshes": {"procedural_models": {"mug": 6, "bottle": 6}},
    "masks": {"renderer": "rasteriser"},
    "rotated_splits": {"renderer": "rasteriser"},
    "unet_search": {"trials": 1, "epochs": 1},
    "unet": {"epochs": 2},
    "policies": {"approaches": ["total", "gain"], "steps_per_stage": 256, "gain_iterations": 3},
    "rollouts": {"references": ["random", "even", "oracle"], "ray_limit": 20},
    "per_step_evaluation": {"resamples": 20},
    "per_grasp_evaluation": {"resamples": 20},
}
ALL = in_order(defs)


def run_config(**settings: dict[str, Any]) -> dict[str, Any]:
    """Run config of the tiny chain, with `settings` (asset → fields) over it."""
    ops = {asset: {**TINY.get(asset, {}), **settings.get(asset, {})} for asset in ALL}
    return {"ops": {asset: {"config": fields} for asset, fields in ops.items() if fields}}


def plain(home: Path, **variables: str) -> dict[str, str]:
    """The variables of a shell where nothing but the home and these was exported."""
    binaries = Path(sys.executable).parent
    return {
        "PATH": f"{binaries}:/usr/local/bin:/usr/bin:/bin",
        "HOME": os.environ["HOME"],
        # Only the folder above it counts; the tests may run in an environment elsewhere.
        "VIRTUAL_ENV": str(REPOSITORY / "tests"),
        "TACTILE_HOME": str(home),
        **variables,
    }


def shell(
    command: str, home: Path, *, whatever_it_says: bool = False, **variables: str
) -> subprocess.CompletedProcess:
    """Run a command as in a shell where .venv/bin/activate was sourced and nothing exported; where
    that failed only if it is to go on `whatever_it_says`."""
    return subprocess.run(
        ["bash", "-c", f". ./environment.sh {';' if whatever_it_says else '&&'} {command}"],
        env=environment(home, **variables),
        capture_output=True,
        text=True,
        cwd=REPOSITORY,
    )


def begin(command: str, home: Path, **variables: str) -> subprocess.Popen:
    """Begin a command as `shell` does; its process is the command's own."""
    return subprocess.Popen(
        ["bash", "-c", f". ./environment.sh && exec {command}"],
        env=environment(home, **variables),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        cwd=REPOSITORY,
    )


def environment(home: Path, **variables: str) -> dict[str, str]:
    """The same in the profile `smoke`, unless `variables` name another."""
    return plain(home, **{"TACTILE_PROFILE": "smoke", **variables})


def until(
    condition: Callable[[], object], seconds: float = 600, telling: Callable[[], str] = str
) -> None:
    """Wait for it; where it does not come the test fails with what `telling` says."""
    last = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < last, f"It did not come in {seconds:.0f} s. {telling()}"
        time.sleep(0.1)


@dg.job
def nothing() -> None:
    pass


@dataclass(frozen=True)
class Platform:
    """A home with its Dagster instance, and ways to run assets there in this process."""

    home: Path
    instance: dg.DagsterInstance

    @property
    def store(self) -> Store:
        return Store(home=str(self.home), artifacts=str(self.home / "artifacts"))

    def materialise(
        self, *assets: str, config: dict[str, Any] | None = None, raise_on_error: bool = True
    ) -> dg.ExecuteInProcessResult:
        """Materialise assets, with their checks."""
        return dg.materialize(
            [*defs.assets, *defs.asset_checks],
            selection=dg.AssetSelection.assets(*assets),
            instance=self.instance,
            resources={**defs.resources, "store": self.store},
            run_config=config if config is not None else run_for(assets),
            raise_on_error=raise_on_error,
        )

    def check(self, *assets: str) -> dg.ExecuteInProcessResult:
        """Run the checks of assets alone."""
        return dg.materialize(
            [*defs.assets, *defs.asset_checks],
            selection=dg.AssetSelection.checks_for_assets(*map(dg.AssetKey, assets)),
            instance=self.instance,
            resources={**defs.resources, "store": self.store},
            raise_on_error=False,
        )

    def data_versions(self, assets: list[str]) -> dict[str, str]:
        """The data version of each asset's latest materialisation."""
        versions = {}
        for asset in assets:
            event = self.instance.get_latest_materialization_event(dg.AssetKey(asset))
            assert event is not None and event.asset_materialization is not None
            versions[asset] = event.asset_materialization.tags["dagster/data_version"]
        return versions


def run_for(assets: tuple[str, ...], **settings: dict[str, Any]) -> dict[str, Any]:
    """The part of the tiny run config that concerns `assets`."""
    ops = run_config(**settings)["ops"]
    return {"ops": {asset: ops[asset] for asset in assets if asset in ops}}


def run_whole_chain(command: str, home: Path) -> subprocess.CompletedProcess:
    config = home / "tiny.yaml"
    config.write_text(json.dumps(run_config()))
    done = shell(f"{command} -c {config}", home)
    assert done.returncode == 0, done.stdout + done.stderr
    return done


def in_study(code: str, *arguments: str):
    """What a process of the profile `study` prints last, as JSON."""
    done = subprocess.run(
        [sys.executable, "-c", code, *arguments],
        cwd=REPOSITORY, env={**os.environ, "TACTILE_PROFILE": "study"},
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])
