"""What the tests need of Dagster that it offers under no public name (1.13.27), in one place."""

import dagster as dg
from dagster._core.definitions.data_version import CachingStaleStatusResolver, StaleStatus
from dagster._core.loader import LoadingContextForTest


def stale_assets(
    instance: dg.DagsterInstance, definitions: dg.Definitions, assets: list[str]
) -> set[str]:
    """Those of `assets` that the UI shows as stale or missing."""
    graph = definitions.get_repository_def().asset_graph
    resolver = CachingStaleStatusResolver(instance, graph, LoadingContextForTest(instance))
    return {
        asset for asset in assets
        if resolver.get_status(dg.AssetKey(asset)) != StaleStatus.FRESH
    }  # fmt: skip
