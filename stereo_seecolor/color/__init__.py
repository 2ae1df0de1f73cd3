"""Fits the water to images and range maps, and removes it from them.

>>> from stereo_seecolor.color import correct, fit  # doctest: +SKIP
>>> water = fit(image, range_m)  # doctest: +SKIP
>>> correct(image, range_m, water).image  # doctest: +SKIP
"""

from stereo_seecolor.color.corrector import Corrector
from stereo_seecolor.color.library import correct, fit
from stereo_seecolor.color.table.moment_table import MomentTable
from stereo_seecolor.config import ColorConfig
from stereo_seecolor.records import Correction, Water

__all__ = ["ColorConfig", "Correction", "Corrector", "MomentTable", "Water", "correct", "fit"]
