"""What the steps inside `policies` hand each other."""

from tactile_core.settings import PolicySettings, Settings


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
