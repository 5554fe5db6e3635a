"""What the steps inside `policies` hand each other."""

from tactile_core.machine import has_gpu
from tactile_core.settings import PolicySettings, Settings
from tactile_core.spread import on_cluster

# Of steps that take a GPU each; dagster.yaml lets one of them work at a time. A Ray cluster counts
# its GPUs itself.
POOL = "gpu" if has_gpu() and not on_cluster() else None


class PlannedTraining(Settings):
    """One policy to train, and once it is trained the version of its weights."""

    approach: str
    seed: int
    settings: PolicySettings
    version: str = ""

    @property
    def name(self) -> str:
        """Name of the policy's directory."""
        return f"{self.approach}-{self.seed}"
