"""A game on one's own machine: feel out a hidden shape, and a policy feels out the same."""
