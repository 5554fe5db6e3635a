"""Nothing is tested on what it was trained on."""

from collections.abc import Mapping

import pandas as pd

from tactile_core.dataset.shapes import Shapes
from tactile_core.errors import TactileError


def refuse_known(
    test: Shapes, trained_on: Mapping[str, pd.DataFrame], *, by_name: bool, remedy: str
) -> None:
    """Raises `TactileError` where a net was trained on an object that `test` holds.

    trained_on : who (as it is to be named) → model_id and geometry of all it has seen, see
        `Shapes.models`
    by_name : whether equal model ids are equal objects, as within one data set; else only the
        geometry tells
    remedy : what to do about it
    """
    models = test.models()
    for who, seen in trained_on.items():
        known = models["geometry"].isin(seen["geometry"])
        if by_name:
            known |= models["model_id"].isin(seen["model_id"])
        if known.any():
            first = models.loc[known, "model_id"].iloc[0]
            raise TactileError(
                f"{known.sum()} of the {len(models)} models to test on were trained on by {who} "
                f"(first: {first}): {remedy}"
            )
