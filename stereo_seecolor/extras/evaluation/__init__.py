"""Measures quality: on color charts, against known truth, between views; and other color methods to compare with."""

from stereo_seecolor.extras.evaluation.baselines import METHODS, contrast_stretch, gray_world, sea_thru, simple_model

__all__ = ["METHODS", "contrast_stretch", "gray_world", "sea_thru", "simple_model"]
