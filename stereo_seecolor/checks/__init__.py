"""Checks of a dive before its results are used: its image files, its pairs, its calibration and its
water.

A check answers with notes, a line each: what is wrong, where, what to do. It says nothing where all
is well, or where it cannot be told.
"""
