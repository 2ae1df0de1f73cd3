"""The checks of a dive, as one list.

``run``, ``range``, ``check`` and ``inspect`` ask the same questions before the work.
"""

from stereo_seecolor.checks.channel_order import channel_order, order_of_sides
from stereo_seecolor.checks.focal_lengths import changed_focal_lengths
from stereo_seecolor.checks.image_files import compression, cut_out, form
from stereo_seecolor.checks.misplaced_maps import misplaced_maps
from stereo_seecolor.checks.range_maps import disparities
from stereo_seecolor.checks.sides_and_mosaics import gray_side, shifted_mosaic

IMAGE_CHECKS = (
    cut_out,  # reads the heads of 4 files
    compression,  # one head
    form,  # one head
    changed_focal_lengths,  # the heads of 500 pairs
    gray_side,  # 3 pairs
    shifted_mosaic,  # 3 pairs
    channel_order,  # 5 left images
    order_of_sides,  # 3 pairs
)
"""Of pairs of images, in the order of their notes."""
RANGED_CHECKS = (
    compression,
    form,
    disparities,  # 6 images and their maps
    misplaced_maps,  # 6 images and 18 maps
)
"""Of images with range maps."""
