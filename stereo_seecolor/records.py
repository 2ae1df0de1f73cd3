"""The records that stages exchange: frozen dataclasses, with unit and shape of every field, and NaN
for unknown values.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from calibration.transforms import inverse
from stereo_seecolor.water.model import PerChannel as PerChannel
from stereo_seecolor.water.model import Water as Water

Image = NDArray[np.uint8] | NDArray[np.uint16]
"""(H, W, 3) RGB at the camera's own bit depth, 0..255 or 0..65535."""

Map = NDArray[np.float32]
"""(H, W) float32, NaN = unknown."""

Mask = NDArray[np.bool_]
"""(H, W) bool."""

Array = NDArray[np.float64]
"""float64 of any shape."""


@dataclass(frozen=True)
class Capture:
    """Metadata that a camera recorded with an image; None = not recorded.

    Attributes:
        exposure_s: Exposure time, seconds.
        gain: Factor; 1 = 0 dB or ISO 100.
        aperture: f-number.
        captured_s: Seconds since 1970.
        latitude_deg: WGS84.
        longitude_deg: WGS84.
        exif: The EXIF block for the corrected image, upright and without a thumbnail; b"" = none.
    """

    exposure_s: float | None = None
    gain: float | None = None
    aperture: float | None = None
    captured_s: float | None = None
    latitude_deg: float | None = None
    longitude_deg: float | None = None
    exif: bytes = b""

    @property
    def relative_exposure(self) -> float | None:
        """Brightness of a scene up to a constant of the camera: exposure_s gain / aperture^2.

        What is not recorded counts as constant; None where neither exposure nor gain is recorded.
        """
        if self.exposure_s is None and self.gain is None:
            return None
        return (self.exposure_s or 1.0) * (self.gain or 1.0) / (self.aperture or 1.0) ** 2


@dataclass(frozen=True, eq=False)
class StereoFrame:
    """One pair, raw or rectified.

    Attributes:
        name: Name of the frame, also of its files.
        left: (H, W, 3) uint8 or uint16 RGB.
        right: The same for the right camera.
        timestamp_s: Seconds; None if the name contains no time.
        left_capture: Metadata of the left image.
        right_capture: Metadata of the right image.
    """

    name: str
    left: Image
    right: Image
    timestamp_s: float | None = None
    left_capture: Capture = Capture()
    right_capture: Capture = Capture()


def is_monochrome(image: NDArray[np.generic]) -> bool:
    """True where red, green and blue are equal everywhere, and the image is not uniform."""
    sample = image[::16, ::16]  # enough to tell nearly every color image
    if not (sample == sample[..., :1]).all() or not (image == image[..., :1]).all():
        return False
    return bool((image[:1, :1] != image).any())


@dataclass(frozen=True, eq=False, repr=False)
class RangeMap:
    """The distance of each pixel of the rectified left image.

    Attributes:
        disparity: (H, W) float32, pixels, x_left - x_right; NaN = unknown, as in all maps here.
        depth_m: (H, W) float32, meters, Z along the optical axis.
        range_m: (H, W) float32, meters along the ray; the light travels this distance.
        range_std_m: (H, W) float32, meters, standard error of ``range_m``.
        confidence: (H, W) float32, [0, 1], 0 where unknown.
        filled: (H, W) bool, True where the value was not measured but filled in from neighbors;
            these pixels have confidence 0.
        warnings: One line each.
        vertical_px: Vertical offset of the right image below the left one after rectification,
            pixels; NaN if unknown.
        right_sharpness: Contrast of fine details, relative to that of coarse ones, in the right
            image over that in the left one; NaN if unknown.
        rows_are_off: Whether ``vertical_px``, at the size that was matched, is so large that ranges
            are biased.
    """

    disparity: Map
    depth_m: Map
    range_m: Map
    range_std_m: Map
    confidence: Map
    filled: Mask
    warnings: tuple[str, ...] = ()
    vertical_px: float = math.nan
    right_sharpness: float = math.nan
    rows_are_off: bool = False

    @classmethod
    def of_ranges(cls, range_m: Map, measured: Mask, warnings: tuple[str, ...] = ()) -> "RangeMap":
        """A map with only the given ranges; all other values are NaN.

        Args:
            range_m: (H, W) float32, meters along the ray, NaN where unknown.
            measured: (H, W) bool, True where the range was measured, not filled in.
            warnings: One line each.

        Returns:
            The range map.
        """
        nothing = np.broadcast_to(np.float32(np.nan), range_m.shape)  # takes no memory
        known = np.isfinite(range_m)
        return cls(
            nothing,
            nothing,
            range_m,
            nothing,
            (known & measured).astype(np.float32),
            known & ~measured,
            warnings,
        )

    def __repr__(self) -> str:
        """Size, how much was measured, and the ranges that it spans."""
        known_m = self.measured_m[np.isfinite(self.measured_m)]
        span = f", {known_m.min():.2f} to {known_m.max():.2f} m" if known_m.size else ""
        height, width = self.range_m.shape
        return (
            f"RangeMap({width}x{height}, {known_m.size / max(self.range_m.size, 1):.1%} "
            f"measured{span})"
        )

    def each(self, function: Callable[[NDArray[Any]], NDArray[Any]]) -> "RangeMap":
        """Apply a function to every map, such as a rotation.

        Args:
            function: Takes and gives an array (H, W).

        Returns:
            The range map of the results.
        """
        maps: dict[str, Any] = {
            one.name: function(values)
            for one in fields(self)
            if isinstance(values := getattr(self, one.name), np.ndarray)
        }
        return replace(self, **maps)

    @classmethod
    def unknown(cls, shape: tuple[int, int], warning: str) -> "RangeMap":
        """A map in which every pixel is unknown.

        Args:
            shape: (H, W).
            warning: One line that states the reason.

        Returns:
            The range map.
        """
        nothing = np.full(shape, np.nan, np.float32)
        none = np.zeros(shape, np.float32)
        return cls(nothing, nothing, nothing, nothing, none, np.zeros(shape, np.bool_), (warning,))

    def with_ranges(self, range_m: Map, filled: Mask) -> "RangeMap":
        """The same map with other ranges.

        Args:
            range_m: (H, W) float32, meters along the ray.
            filled: (H, W) bool, True where these were not measured.

        Returns:
            The range map.
        """
        return replace(self, range_m=range_m, filled=filled)

    @cached_property  # asked for up to four times a map
    def measured_m(self) -> Map:
        """range_m without filled-in values."""
        return (
            np.where(self.filled, np.float32(np.nan), self.range_m)
            if self.filled.any()
            else self.range_m
        )


@dataclass(frozen=True, eq=False, repr=False)
class Correction:
    """A corrected frame.

    Attributes:
        image: (H, W, 3) RGB, the colors J of the paper at the bit depth of the input.
        unknown: (H, W) bool, True where no range was known.
        unrecoverable: (H, W) bool, True where noise or the error of the backscatter limits the gain
            of a channel, or the camera clipped a channel.
        clipped_fraction: Fraction of the pixels with a known range that have a channel at full
            scale.
        water: The water that was removed.
        exposure: As in ``Water``.
        highlights: As in ``Water``.
        warnings: One line each.
        linear: (H, W, 3) float32 linear light, unclipped; None unless requested.
    """

    image: Image
    unknown: Mask
    unrecoverable: Mask
    clipped_fraction: float
    water: Water
    exposure: float = 1.0
    highlights: float = 1.0
    warnings: tuple[str, ...] = ()
    linear: NDArray[np.float32] | None = None

    def __repr__(self) -> str:
        """Shape, how much is known, clipped and unrecoverable, and the exposure."""
        pixels = max(math.prod(self.unknown.shape), 1)
        known, lost = (
            1 - float(self.unknown.sum()) / pixels,
            float(self.unrecoverable.sum()) / pixels,
        )
        fractions = (
            f"{known:.1%} known, {self.clipped_fraction:.2%} clipped, {lost:.1%} unrecoverable"
        )
        return (
            f"Correction({tuple(self.image.shape)} {self.image.dtype}, {fractions}, exposure "
            f"{self.exposure:.3g})"
        )

    def one_band(self) -> "Correction":
        """The correction of a monochrome camera's image: green, in all three channels."""
        linear = None if self.linear is None else self.linear[..., [1, 1, 1]]
        return replace(self, image=self.image[..., [1, 1, 1]], linear=linear)


@dataclass(frozen=True, eq=False)
class FrameResult:
    """The result of all stages for a pair.

    Attributes:
        frame: The rectified pair.
        range_map: Its range map.
        correction: Its left image in true colors.
        seconds: Seconds that each stage took, by name.
    """

    frame: StereoFrame
    range_map: RangeMap
    correction: Correction
    seconds: dict[str, float]

    @property
    def warnings(self) -> tuple[str, ...]:
        """The warnings of all stages."""
        return self.range_map.warnings + self.correction.warnings


@dataclass(frozen=True, eq=False)
class SurveyFrame:
    """A finished pair for the map: corrected colors and ranges of the rectified left camera.

    Attributes:
        name: As in ``StereoFrame``.
        timestamp_s: Seconds; None without a time stamp.
        color: (H, W, 3) uint8 RGB.
        range_m: (H, W) float32, meters along the ray, measured pixels only.
        range_std_m: (H, W) float32, meters.
        confidence: (H, W) uint8, 0..255 for 0..1 as in its file; 0 where unknown.
        unrecoverable: As in ``Correction``; None where it is not known.
        right_sharpness: As in ``RangeMap``.
    """

    name: str
    timestamp_s: float | None
    color: NDArray[np.uint8]
    range_m: Map
    range_std_m: Map
    confidence: NDArray[np.uint8]
    unrecoverable: Mask | None = None
    right_sharpness: float = math.nan

    def scaled(self, scale: float) -> "SurveyFrame":
        """The frame with its ranges multiplied, where a better scale of the rig is known.

        Args:
            scale: Factor.

        Returns:
            The frame; itself for a factor of 1.
        """
        factor = np.float32(scale)
        return (
            self
            if scale == 1
            else replace(self, range_m=factor * self.range_m, range_std_m=factor * self.range_std_m)
        )

    @cached_property
    def color_is_doubtful(self) -> Mask:
        """True where a channel is clipped, or could not be recovered."""
        # minima over the last axis take ten times as long
        r, g, b = (np.ascontiguousarray(self.color[..., c]) for c in range(3))
        clipped = (np.maximum(np.maximum(r, g), b) >= 254) | (np.minimum(np.minimum(r, g), b) == 0)
        doubtful: Mask = clipped if self.unrecoverable is None else clipped | self.unrecoverable
        return doubtful


@dataclass(frozen=True)
class GeoOrigin:
    """Where the map's (0, 0, 0) lies on Earth, at the water's surface: z is minus the depth.

    Attributes:
        latitude_deg: WGS84.
        longitude_deg: WGS84.
        utm_epsg: EPSG code of the UTM zone whose eastings and northings the map's x and y are; the
            degrees are then those of a place in the survey, and not of (0, 0). None: x and y are
            meters east and north of the place.
        depth_known: False where the positions come without depths: z is then a height over some
            level, not over the water's surface.
    """

    latitude_deg: float
    longitude_deg: float
    utm_epsg: int | None = None
    depth_known: bool = True


NEAR_FIX = 0.125
"""Of the time between two fixes: what lies so near to one of them is known by it."""


@dataclass(frozen=True, eq=False)
class Trajectory:
    """Poses of the left camera: p_world = T_world_camera @ p_camera, meters.

    Attributes:
        names: N names of frames; "" where the file names none.
        timestamps_s: (N,) float64, seconds; NaN where the file holds no time.
        T_world_camera: (N, 4, 4) float64; camera axes x right, y down, z forward; world
            east-north-up when georeferenced.
        up: "z" where the world's z axis points up; "unknown" where the format does not say (KITTI:
            the axes of the first camera).
        origin: Where the world's origin lies on Earth; None for a local map.
        camera: "rectified" where the poses are those of the rectified left camera; "raw" where they
            are those of the camera as it was calibrated and mounted, which rectification turns.
        fixes: True for positions alone, such as a buoy's: heights and attitudes mean nothing.
        absolute: Fixes beside poses, which place them on Earth; None where there are none.
        position_step_m: What the file rounds positions to; 0 where that is too fine to matter.
        notes: What a person should know of how the file was read.
        T_vehicle_camera: (4, 4) float64, how the camera sits on the vehicle (x forward, y
            starboard, z down) whose roll, pitch and heading the file gives; None where it gives
            the camera's own attitude.
        fixes_s: (M,) float64, times at which positions were measured, between which they are
            interpolated; None where each row has its own.
    """

    names: tuple[str, ...]
    timestamps_s: NDArray[np.float64]
    T_world_camera: NDArray[np.float64]
    up: Literal["z", "unknown"] = "z"
    origin: GeoOrigin | None = None
    camera: Literal["raw", "rectified"] = "rectified"
    fixes: bool = False
    absolute: "Trajectory | None" = None
    position_step_m: float = 0.0
    notes: tuple[str, ...] = ()
    T_vehicle_camera: NDArray[np.float64] | None = None
    fixes_s: NDArray[np.float64] | None = None

    def of_rectified(self, T_rectified_left: NDArray[np.float64]) -> "Trajectory":
        """The poses of the rectified left camera.

        Args:
            T_rectified_left: (4, 4) float64, from the axes of the camera as calibrated.

        Returns:
            The trajectory; itself where it is that of the rectified camera.
        """
        if self.camera == "rectified":
            return self
        T_left_rectified = inverse(T_rectified_left)
        mounted = self.T_vehicle_camera
        return replace(
            self,
            T_world_camera=self.T_world_camera @ T_left_rectified,
            camera="rectified",
            T_vehicle_camera=None if mounted is None else mounted @ T_left_rectified,
        )


Numbers = Literal["ranges", "colors"]
"""Of a dive's output, of which checks find whether they are wrong."""

Status = Literal["ok", "failed", "unpaired", "pending"]
"""pending: the run was stopped before this pair."""


@dataclass(frozen=True, slots=True)
class FrameRow:
    """The outcome of one pair, or of one file without a partner: a row of frames.csv.

    kept: True where an earlier run had finished it. hashes: SHA-256 of its files, by side. seconds:
    name of a stage -> seconds.
    facts: numbers by column, see dive/frames.py.
    """

    name: str
    status: Status = "ok"
    left: str = ""
    right: str = ""
    timestamp_s: float | None = None
    error: str = ""
    warnings: tuple[str, ...] = ()
    kept: bool = False
    hashes: dict[str, str] = field(default_factory=dict)
    seconds: dict[str, float] = field(default_factory=dict)
    facts: dict[str, float] = field(default_factory=dict)

    @property
    def line(self) -> str:
        """The outcome as a line of text, with the name once, also if the error begins with it."""
        return f"{self.status}: {self.name}: {self.error.removeprefix(f'{self.name}: ')}"

    def then(self, later: "FrameRow") -> "FrameRow":
        """This row and a later stage's as one: seconds added, warnings once; kept if both were."""
        seconds = {
            key: self.seconds.get(key, 0.0) + later.seconds.get(key, 0.0)
            for key in self.seconds | later.seconds
        }
        return replace(
            later,
            left=later.left or self.left,
            right=later.right or self.right,
            timestamp_s=self.timestamp_s if later.timestamp_s is None else later.timestamp_s,
            warnings=tuple(dict.fromkeys(self.warnings + later.warnings)),
            kept=self.kept and later.kept,
            hashes=self.hashes | later.hashes,
            seconds=seconds,
            facts=self.facts | later.facts,
        )
