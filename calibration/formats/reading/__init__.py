"""Calibration files as keys, values and numbers, before any format is known."""
