"""The check of policies."""

import dagster as dg
from upath import UPath

from tactile_assets.checks.telling import first
from tactile_assets.io_managers import UNetsBySeed


@dg.asset_check(asset="policies", additional_ins={"unets": dg.AssetIn("unet")})
def policies_are_sound(policies: list[UPath], unets: UNetsBySeed) -> dg.AssetCheckResult:
    """Every policy was trained with the U-Net that it goes with, and no weight is infinite or no
    number."""
    from tactile_core.exploration.policies.store import describe, read_weights
    from tactile_core.reconstruction.unets import seed_of

    stored = {directory.name: describe(directory) for directory in policies}
    versions = {seed: unet.version() for seed, unet in unets.items()}
    of_another = [
        name
        for name, policy in stored.items()
        if policy.unet != versions[seed_of(unets, policy.seed)]
    ]
    broken = [
        directory.name
        for directory in policies
        if not all(
            weights.isfinite().all()
            for weights in read_weights(directory, stored[directory.name]).values()
        )
    ]
    return dg.AssetCheckResult(
        passed=not of_another and not broken,
        description=f"{len(of_another)} of {len(policies)} policies are of another U-Net, "
        f"{len(broken)} have weights that are not finite",
        metadata={
            "policies": len(policies),
            "of_another_unet": len(of_another),
            "with_weights_not_finite": len(broken),
            "first": first([*of_another, *broken]),
        },
    )
