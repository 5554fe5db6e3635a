"""Checks where a wrong result would otherwise look fine, by the wings of the assets.

Each reads what the assets stored.
"""
