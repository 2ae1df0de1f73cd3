"""Formats of single makers and data sets, read alone."""
