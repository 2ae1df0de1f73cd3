"""Measures quality: on color charts, against known truth, between views; and other color methods to
compare with.
"""
