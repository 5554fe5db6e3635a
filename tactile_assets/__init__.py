"""The Dagster layer: eleven assets, their checks and their automation, over `tactile_core`."""
