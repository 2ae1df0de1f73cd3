"""The settings of the inputs: pairs, images, videos, the calibration."""

from typing import Literal

from pydantic import Field, field_validator

from stereo_seecolor.config.stage import FilePath, StageConfig


class InputConfig(StageConfig):
    """How files are read and paired."""

    pairing: Literal["auto", "name", "timestamp"] = Field(
        "auto",
        description="Match left and right by name stem, by the time stamp in the name, or by "
        "name and else by time stamp.",
    )
    timestamp_tolerance_s: float = Field(
        0.01, ge=0, description="Largest difference between the two time stamps of a pair, seconds."
    )
    bayer: Literal["auto", "none", "rggb", "bggr", "gbrg", "grbg"] = Field(
        default="auto",
        description="Color filter pattern of single-channel raw images: the first two pixels "
        "of the first two rows. auto: recognized from pairs spread over the dive, assuming "
        "that red is darker than blue; for live with folders, none.",
    )
    significant_bits: Literal["auto", None, 10, 12, 14] = Field(
        default="auto",
        description="Bits that 16-bit files use (12 for a 12-bit sensor stored unshifted). auto: "
        "the smallest number that fits pairs spread over the dive; for live with folders, none. "
        "none: all 16.",
    )
    channels: Literal["rgb", "bgr"] = Field(
        default="rgb",
        description="bgr: the files store the channels in the order blue, green, red, like OpenCV "
        "arrays written by another library.",
    )
    range_units_per_m: float | None = Field(
        default=None,
        gt=0,
        description="Units per meter in the range maps for correct and evaluate: 1000 for "
        "millimeters, 100 for centimeters, 5000 for TUM RGB-D, 256 for KITTI. Not set: 1 "
        "for floating-point numbers, 1000 for integers.",
    )
    right_half_first: bool = Field(
        default=False,
        description="For images and videos that show both sides: the left (or upper) half "
        "belongs to the right camera.",
    )
    exposures: FilePath | None = Field(
        default=None,
        description="CSV with exposure_s and gain of each image, by file name; missing values are "
        "read from EXIF.",
    )
    refine: bool = Field(
        default=False,
        description="Refine the calibration before the run, from pairs spread over the dive, "
        "in case the rig has moved. Not used if the rows of pairs left out of the estimate "
        "agree better without.",
    )
    flat_port: str | None = Field(
        default=None,
        description="For cameras behind flat windows that were calibrated in air: the "
        "distance from lens to window and the thickness of the window, for example "
        "30mm:10mm; a third length is the distance at which ranges are exact (default 1.5m).",
    )
    video_step: float = Field(
        default=1.0,
        gt=0,
        description="Which frames of a video are used. A whole number n: every nth frame. A number "
        "below 1: the next frame that overlaps the last one used by less than this "
        "fraction (0.7 is good for maps).",
    )
    video_skip_blurred: bool = Field(
        default=False,
        description="Leave out video frames that are much less sharp than the frames around "
        "them, on either side.",
    )
    video_offset_s: float | None = Field(
        default=None,
        description="For two videos: seconds to add to the time of a left frame to get the time of "
        "the right frame. Not set: measured.",
    )

    @property
    def other_channels(self) -> str:
        """The setting for files with red and blue exchanged, compared with these settings."""
        return f"input.channels={'rgb' if self.channels == 'bgr' else 'bgr'}"

    @property
    def video_overlap(self) -> float | None:
        """The overlap that selects frames of a video; None if every nth frame is used."""
        return self.video_step if self.video_step < 1 else None

    @property
    def video_every(self) -> int:
        """The step between used frames of a video, unless the overlap selects them."""
        return max(1, int(self.video_step))

    @field_validator("video_step")
    @classmethod
    def _whole_or_below_1(cls, value: float) -> float:
        if value > 1 and not value.is_integer():
            raise ValueError("must be a whole number, or below 1")
        return value
