"""What environments, policies and `tactile feel` are made of where nothing else is given."""

from upath import UPath

from tactile_core.exploration.pretrained import pretrained
from tactile_core.home import find_artifacts

ROTATED_SPLITS = "rotated_splits.parquet"
UNET = "unet/settings.json"
POLICIES = "policies/index.json"


def at_hand(*needed: str) -> UPath:
    """The artifacts of the home's run where it has stored all of `needed` (by default what an
    environment is made of, `ROTATED_SPLITS` and `UNET`); else those that the package ships."""
    artifacts = UPath(find_artifacts())
    if all((artifacts / name).exists() for name in needed or (ROTATED_SPLITS, UNET)):
        return artifacts
    return pretrained()
