"""Report, section VII: rollouts over the test split, their statistics and figures."""
