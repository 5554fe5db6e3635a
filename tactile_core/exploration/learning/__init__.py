"""How policies learn: approaches, PPO, gains, one training from start to store."""
