"""The Dagster layer: eleven assets, their checks and their automation, over `tactile_core`."""

import warnings

from dagster import BetaWarning

# Of no use to whoever runs a pinned Dagster; `--select '*'` alone sets one off.
warnings.filterwarnings("ignore", category=BetaWarning)
