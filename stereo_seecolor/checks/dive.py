"""The checks of a dive, as one list.

``run``, ``range``, ``check`` and ``inspect`` ask the same questions before the work.
"""

from stereo_seecolor.checks.channel_order import channel_order, order_of_sides
from stereo_seecolor.checks.focal_lengths import changed_focal_lengths
from stereo_seecolor.checks.image_files import compression, cut_out, form
from stereo_seecolor.checks.misplaced_maps import misplaced_maps
from stereo_seecolor.checks.range_maps import disparities
from stereo_seecolor.checks.sides_and_mosaics import gray_side, shifted_mosaic
from stereo_seecolor.checks.verdict import Check

_COMPRESSION = Check("strong compression", "the head of a file", compression)
_FORM = Check("pages and palettes", "the head of a file", form)

IMAGE_CHECKS = (
    Check("images cut out or zoomed", "the heads of 4 files", cut_out),
    _COMPRESSION,
    _FORM,
    Check("focal lengths that EXIF says change", "heads of 500 pairs", changed_focal_lengths),
    Check("a left side without color", "3 pairs", gray_side),
    Check("mosaics read one column off", "3 pairs", shifted_mosaic),
    Check("red and blue exchanged from a frame on", "5 left images", channel_order),
    Check("red and blue exchanged between the sides", "3 pairs", order_of_sides),
)
"""Of pairs of images, in the order of their notes."""
RANGED_CHECKS = (
    _COMPRESSION,
    _FORM,
    Check("range maps that hold disparities", "6 images and their maps", disparities),
    Check("range maps of another place", "6 images and 18 maps", misplaced_maps),
)
"""Of images with range maps."""
