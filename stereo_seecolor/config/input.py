"""The settings of the inputs: pairs, images, videos, the calibration."""

from typing import Literal

from pydantic import Field

from stereo_seecolor.config.stage import FilePath, StageConfig


class InputConfig(StageConfig):
    """How files are read and paired."""

    pairing: Literal["auto", "name", "timestamp"] = Field(
        "auto",
        description="Match left and right by name stem, by the time stamp in the name, or by "
        "name and else by time stamp.",
    )
    timestamp_tolerance_s: float = Field(
        0.01, ge=0, description="Largest difference of the two time stamps of a pair, seconds."
    )
    bayer: Literal["auto", "none", "rggb", "bggr", "gbrg", "grbg"] = Field(
        default="auto",
        description="Color filter pattern of single-channel raw images, by the first two pixels "
        "of the first two rows. auto: "
        "recognized from pairs spread over the dive, assuming that red is darker than blue; "
        "correct, and live with folders, "
        "take auto as none.",
    )
    significant_bits: Literal["auto", None, 10, 12, 14] = Field(
        default="auto",
        description="Bits that 16-bit files really use (12 for a 12-bit sensor stored unshifted); "
        "scaled to full. auto: the "
        "fewest that hold the values of pairs spread over the dive; correct, and live with "
        "folders, take all 16. none: all 16.",
    )
    channels: Literal["rgb", "bgr"] = Field(
        default="rgb",
        description="bgr: the files hold blue in the place of red, as pictures of OpenCV that "
        "were written by another library do. "
        "A run names images that look like it.",
    )
    range_units_per_m: float | None = Field(
        default=None,
        gt=0,
        description="Of range maps given to correct and evaluate: how many of their units are a "
        "meter: 1000 for millimeters, "
        "100 for centimeters, 5000 for TUM RGB-D, 256 for KITTI. Not set: 1 for floating point, "
        "1000 for integers.",
    )
    right_half_first: bool = Field(
        default=False,
        description="Of images and videos that show both sides: the left (or upper) half is the "
        "right camera's.",
    )
    exposures: FilePath | None = Field(
        default=None,
        description="CSV with exposure_s and gain of each image, by its file name; values that "
        "it lacks are read from EXIF.",
    )
    refine: bool = Field(
        default=False,
        description="Estimate what has moved in the rig since its calibration from pairs spread "
        "over the dive, before the run. "
        "Used only where rows of pairs left out of the estimate agree better.",
    )
    flat_port: str | None = Field(
        default=None,
        description="For cameras that were calibrated in air and look through flat windows under "
        "water: the distance from lens "
        "to window and the thickness of the window, such as 30mm:10mm; a third length is the "
        "range at which ranges are exact "
        "(1.5m).",
    )
    video_every: int = Field(default=1, ge=1, description="Of a video, take every nth frame.")
    video_overlap: float | None = Field(
        default=None,
        gt=0,
        lt=1,
        description="Of a video, take a frame as soon as it shows less than this fraction of the "
        "last one taken (0.7 suits "
        "maps), instead of every nth.",
    )
    video_skip_blurred: bool = Field(
        default=False,
        description="Of a video, leave out frames that are much less sharp than those around "
        "them, on either side.",
    )
    video_offset_s: float | None = Field(
        default=None,
        description="Of two videos, the time to add to that of a left frame to get that of the "
        "right one, seconds. Not set: "
        "measured.",
    )
