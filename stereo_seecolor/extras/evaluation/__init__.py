"""Measures quality: on color charts, against truth, between views, and of other methods."""
