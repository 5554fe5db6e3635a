"""Who chooses the next ray: rules, PPO, ray scorer, recall; and their files."""
