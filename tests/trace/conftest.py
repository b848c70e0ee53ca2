"""Puts this folder on the path, so that the tests in `lower` find `adaptive_ukf` and `every_operation`.

The folder is no package: as `trace` it would hide the standard library's module of that name.
"""
