"""Calibration from images of a target: its corners, the lens, all views at once, and the report."""
