"""Settings of trainings that only show the way through."""

from tactile_core.settings import PolicySettings

# Two updates in each stage of PPO, six iterations of learning gains.
QUICK = PolicySettings(
    steps_per_stage=512,
    environments=4,
    rays_per_rollout=64,
    batch_size=64,
    epochs=1,
    gain_iterations=6,
    gain_states=8,
    gain_tries=2,
    gain_updates=1,
)
