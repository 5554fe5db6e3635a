"""The assets in an order of their own: Dagster's changes from process to process."""

import dagster as dg


def in_order(definitions: dg.Definitions) -> list[str]:
    """The names of all assets, each after those that it depends on; else by name."""
    waiting = {
        spec.key.to_user_string(): {dep.asset_key.to_user_string() for dep in spec.deps}
        for spec in definitions.resolve_all_asset_specs()
    }
    ordered: list[str] = []
    while waiting:
        ready = min(name for name, deps in waiting.items() if not deps & waiting.keys())
        ordered.append(ready)
        del waiting[ready]
    return ordered
