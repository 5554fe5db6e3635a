"""Ratios of speed, measured side by side in one run: `python -m benchmarks.bench`."""
