"""Checks of a dive before its results are used: image files, pairs, calibration and water.

A check answers with notes, a line each: what is wrong, where, what to do. It says nothing where all
is well, or where it cannot be told.
"""
