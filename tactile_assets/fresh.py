"""Whether another run would make anything new; `make run` asks before it begins one."""

import sys
from typing import Any, cast

import dagster as dg

from tactile_assets.chain import in_order
from tactile_assets.config import PROFILE
from tactile_assets.dagster_internals import stale_assets, verdicts
from tactile_assets.definitions import defs
from tactile_assets.exploration import policies_version
from tactile_assets.metadata import table_version
from tactile_assets.provenance import latest, own_instance
from tactile_assets.real import MESHES
from tactile_assets.resources import Store
from tactile_assets.sources import news_of
from tactile_core.errors import OutOfReachError, TactileError

SOURCES = {"shapenet_meshes": PROFILE.meshes, **({"real_shapes": MESHES} if PROFILE.real else {})}
IN_FOLDERS = {"unet", "policies"}  # all others are tables
DATA_VERSION = "dagster/data_version"  # tag of a materialisation


def main() -> None:
    """Exit with 0 where everything is fresh, else with 1; it says so either way."""
    try:
        with own_instance() as instance:
            reason = reason_to_run(instance, Store.from_environment())
    except TactileError as error:
        sys.exit(f"Error: {error}")
    print(reason or "Everything is fresh: there is nothing to make.")
    sys.exit(1 if reason else 0)


def reason_to_run(instance: dg.DagsterInstance, store: Store) -> str:
    """Why a run with the profile's settings may make something new, in a sentence; "" where it
    would not."""
    assets = in_order(defs)
    if stale := stale_assets(instance, defs, assets):
        return f"To be made: {', '.join(asset for asset in assets if asset in stale)}."
    if own := [asset for asset in assets if configured(instance, asset)]:
        return f"Made with another configuration than the profile's: {', '.join(own)}."
    if reason := what_is_stored(instance, store, assets) or unpassed_checks(instance):
        return reason
    try:
        news = [news_of(instance, asset, source) for asset, source in SOURCES.items()]
    except TactileError as error:
        return f"{error}."
    return next(filter(None, news), "")


def configured(instance: dg.DagsterInstance, asset: str) -> bool:
    """Whether an asset's last materialisation had a run configuration of its own; of others, which
    the run did not make, it may have had one."""
    run = instance.get_run_by_id(latest(instance, asset)[0])
    return run is None or asset in dict(cast(Any, run.run_config)).get("ops", {})


def what_is_stored(instance: dg.DagsterInstance, store: Store, assets: list[str]) -> str:
    """Why it is not what this home's records tell of, in a sentence; "" where it is."""
    if reason := other_content(instance, store, assets):
        return reason
    bare = [asset for asset in assets if not store.has_pictures(latest(instance, asset)[1])]
    return f"Figures are missing, or others: of {', '.join(bare)}." if bare else ""


def other_content(instance: dg.DagsterInstance, store: Store, assets: list[str]) -> str:
    """As `what_is_stored`, whatever the figures are."""
    records = {asset: latest(instance, asset)[1] for asset in assets}
    versions = {asset: stored_version(store, asset) for asset in assets}
    if damaged := [asset for asset in assets if versions[asset] is None]:
        return f"Missing or damaged: {', '.join(damaged)}."
    told = {asset: (records[asset].tags or {}).get(DATA_VERSION) for asset in assets}
    if others := [asset for asset in assets if versions[asset] != told[asset]]:
        return f"Other content than this home made, as its records tell: {', '.join(others)}."
    return ""


def stored_version(store: Store, asset: str) -> str | None:
    """The data version of what an asset stored; None where it is not there, or a byte of it is not
    as it was written. Raises `OutOfReachError` where the store does not answer."""
    from tactile_core.evaluation.of_each_unet import policies_of_each
    from tactile_core.exploration.policies.index import read_index
    from tactile_core.exploration.policies.store import describe
    from tactile_core.parquet import read_table
    from tactile_core.reconstruction.unets import load_unets, version_of

    try:
        if asset not in IN_FOLDERS:
            return table_version(read_table(store.path(f"{asset}.parquet")))
        unets = load_unets(store.path("unet"))
        if asset == "unet":
            return version_of(unets)
        directories = read_index(store.path("policies"))
        policies_of_each(directories, unets)
        return policies_version({place.name: describe(place).version for place in directories})
    except OutOfReachError:
        raise
    except TactileError:
        return None


def unpassed_checks(instance: dg.DagsterInstance) -> str:
    """Which checks did not pass, or were not made of what is stored, in a sentence; "" where all
    passed. A run makes them once more."""
    found = verdicts(instance, defs.get_repository_def().asset_graph.asset_check_keys)
    names = sorted(
        f"{key.name} of {key.asset_key.to_user_string()}{'' if passed is False else ' (not made)'}"
        for key, passed in found.items()
        if not passed
    )
    return f"Checks that have not passed: {', '.join(names)}." if names else ""


if __name__ == "__main__":
    main()
