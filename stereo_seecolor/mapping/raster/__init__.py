"""Mosaic, terrain and metrics of a surface."""
