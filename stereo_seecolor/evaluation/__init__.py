"""How good is it: color charts, known truth, range and cloud errors; and other color methods to compare with."""

from stereo_seecolor.evaluation.baselines import METHODS, contrast_stretch, gray_world, sea_thru, simple_model

__all__ = ["METHODS", "contrast_stretch", "gray_world", "sea_thru", "simple_model"]
