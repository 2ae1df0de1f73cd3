"""Calibration formats of single makers, programs and data sets, added by the entry points of
pyproject.toml as the formats of other packages are.
"""
