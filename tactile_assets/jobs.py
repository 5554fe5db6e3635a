"""What can be run by name, in the UI under Jobs: `dagster job execute --job retrain`."""

import dagster as dg

EVALUATIONS = dg.AssetSelection.groups("evaluation") | dg.AssetSelection.assets(
    "reconstruction_evaluation"
)

whole_chain = dg.define_asset_job(
    "whole_chain",
    selection=dg.AssetSelection.all(),
    description="Every asset, from the meshes to the evaluations, with all checks: `make run`.",
)
dataset = dg.define_asset_job(
    "dataset",
    selection=dg.AssetSelection.groups("dataset"),
    description="From the meshes to the touches. What was trained before becomes stale.",
)
retrain = dg.define_asset_job(
    "retrain",
    selection=dg.AssetSelection.groups("reconstruction", "exploration", "evaluation"),
    description="Search, U-Net, policies and evaluations, on the dataset that is stored.",
)
evaluate = dg.define_asset_job(
    "evaluate",
    selection=EVALUATIONS,
    description="The evaluations of the U-Net and the policies that are stored.",
)

JOBS = [whole_chain, dataset, retrain, evaluate]
