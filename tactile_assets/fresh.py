"""Whether another run would make anything new; `make run` asks before it begins one."""

import sys

import dagster as dg

from tactile_assets.chain import in_order
from tactile_assets.config import PROFILE
from tactile_assets.dagster_internals import stale_assets
from tactile_assets.definitions import defs
from tactile_assets.provenance import latest, own_instance
from tactile_assets.real import MESHES
from tactile_assets.resources import Store
from tactile_assets.sources import news_of
from tactile_core.errors import TactileError

SOURCES = {"shapenet_meshes": PROFILE.meshes, **({"real_shapes": MESHES} if PROFILE.real else {})}
IN_FOLDERS = {"unet", "policies"}  # all others are tables


def main() -> None:
    """Exit with 0 where everything is fresh, else with 1; it says so either way."""
    with own_instance() as instance:
        reason = reason_to_run(instance, Store.from_environment())
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
    if damaged := [asset for asset in assets if not whole(store, asset)]:
        return f"Missing or damaged: {', '.join(damaged)}."
    try:
        news = [news_of(instance, asset, source) for asset, source in SOURCES.items()]
    except TactileError as error:
        return f"{error}."
    return next(filter(None, news), "")


def configured(instance: dg.DagsterInstance, asset: str) -> bool:
    """Whether an asset's last materialisation had a run configuration of its own."""
    run = instance.get_run_by_id(latest(instance, asset)[0])
    return run is None or bool(run.run_config)


def whole(store: Store, asset: str) -> bool:
    """Whether what an asset stored is there, and every byte of it as it was written."""
    from tactile_core.evaluation.of_each_unet import policies_of_each
    from tactile_core.exploration.policies.index import read_index
    from tactile_core.files import read_table
    from tactile_core.reconstruction.unets import load_unets

    try:
        if asset not in IN_FOLDERS:
            read_table(store.path(f"{asset}.parquet"))
            return True
        unets = load_unets(store.path("unet"))
        if asset == "policies":
            policies_of_each(read_index(store.path("policies")), unets)
    except TactileError:
        return False
    return True


if __name__ == "__main__":
    main()
