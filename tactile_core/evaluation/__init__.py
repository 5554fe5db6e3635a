"""Report, section VII: roll-outs over the test split, their statistics and figures."""
