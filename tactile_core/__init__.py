"""Tactile exploration of objects: the library behind the assets, usable without Dagster.

The sub-packages follow the report: `dataset` (section IV), `reconstruction` (V),
`exploration` (VI) and `evaluation` (VII). Imports go one way: evaluation → exploration →
reconstruction → dataset. `figures` draws what each of them made.
"""
