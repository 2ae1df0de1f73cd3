"""What the stages exchange: frozen, units and shapes on every field, NaN for unknown."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.water.model import PerChannel as PerChannel
from stereo_seecolor.water.model import Water as Water

Image = NDArray[np.uint8] | NDArray[np.uint16]
"""(H, W, 3) RGB at the camera's own bit depth, 0..255 or 0..65535."""

Map = NDArray[np.float32]
"""(H, W) float32, NaN = unknown."""

Mask = NDArray[np.bool_]
"""(H, W) bool."""


@dataclass(frozen=True)
class Capture:
    """What a camera recorded beside the pixels of an image; None = not recorded.

    exposure_s: seconds. gain: factor, 1 = 0 dB or ISO 100. aperture: f-number. captured_s: seconds since 1970.
    latitude_deg, longitude_deg: WGS84. exif: the EXIF block for the corrected image, upright and without a thumbnail, b"" = none.
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
        """How bright a scene comes out, up to a constant of the camera: exposure_s gain / aperture^2.

        What is not recorded is taken to be constant; None where neither exposure nor gain is.
        """
        if self.exposure_s is None and self.gain is None:
            return None
        return (self.exposure_s or 1.0) * (self.gain or 1.0) / (self.aperture or 1.0) ** 2


@dataclass(frozen=True, eq=False)
class StereoFrame:
    """One pair: as read, or rectified.

    name: what the outputs are called; left, right: Image; timestamp_s: seconds, or None where the name holds no time.
    left_capture, right_capture: what the cameras recorded of each.
    """

    name: str
    left: Image
    right: Image
    timestamp_s: float | None = None
    left_capture: Capture = Capture()
    right_capture: Capture = Capture()


def is_monochrome(image: NDArray[np.generic]) -> bool:
    """True where red, green and blue are equal everywhere: the picture of a monochrome camera. A uniform image is not."""
    sample = image[::16, ::16]  # enough to tell nearly every color image
    if not (sample == sample[..., :1]).all() or not (image == image[..., :1]).all():
        return False
    return bool((image[:1, :1] != image).any())


@dataclass(frozen=True, eq=False, repr=False)
class RangeMap:
    """What stereo knows of the distance of each pixel of the rectified left image.

    disparity: pixels, x_left - x_right. depth_m: Z along the optical axis. range_m: distance along the ray (what water acts on).
    range_std_m: standard error of range_m. confidence: [0, 1], 0 where unknown.
    filled: True where the value was invented from its neighbors, not measured; such pixels have confidence 0.
    vertical_px: how far right rows lie below left ones, as rectified; NaN where unknown.
    """

    disparity: Map
    depth_m: Map
    range_m: Map
    range_std_m: Map
    confidence: Map
    filled: Mask
    warnings: tuple[str, ...] = ()
    vertical_px: float = math.nan

    @classmethod
    def of_ranges(cls, range_m: Map, measured: Mask, warnings: tuple[str, ...] = ()) -> "RangeMap":
        """A map of which only the ranges are known, and which of them were measured; all else is NaN."""
        nothing = np.broadcast_to(np.float32(np.nan), range_m.shape)  # takes no memory
        known = np.isfinite(range_m)
        return cls(nothing, nothing, range_m, nothing, (known & measured).astype(np.float32), known & ~measured, warnings)

    def __repr__(self) -> str:
        """Size, how much was measured, and the ranges that it spans."""
        known_m = self.measured_m[np.isfinite(self.measured_m)]
        span = f", {known_m.min():.2f} to {known_m.max():.2f} m" if known_m.size else ""
        height, width = self.range_m.shape
        return f"RangeMap({width}x{height}, {known_m.size / max(self.range_m.size, 1):.1%} measured{span})"

    def each(self, function: Callable[[NDArray[Any]], NDArray[Any]]) -> "RangeMap":
        """The range map of ``function`` of every map, such as one that turns them."""
        maps = (self.disparity, self.depth_m, self.range_m, self.range_std_m, self.confidence, self.filled)
        disparity, depth_m, range_m, range_std_m, confidence, filled = (function(values) for values in maps)
        return RangeMap(disparity, depth_m, range_m, range_std_m, confidence, filled, self.warnings, self.vertical_px)

    @classmethod
    def unknown(cls, shape: tuple[int, int], warning: str) -> "RangeMap":
        """The map of (H, W) pixels without a known one, and why."""
        nothing = np.full(shape, np.nan, np.float32)
        none = np.zeros(shape, np.float32)
        return cls(nothing, nothing, nothing, nothing, none, np.zeros(shape, np.bool_), (warning,))

    def with_ranges(self, range_m: Map, filled: Mask) -> "RangeMap":
        """The same map with other ranges, of which ``filled`` were not measured."""
        return replace(self, range_m=range_m, filled=filled)

    @cached_property  # asked for up to four times a map
    def measured_m(self) -> Map:
        """range_m with everything that was filled in taken out again."""
        return np.where(self.filled, np.float32(np.nan), self.range_m) if self.filled.any() else self.range_m


@dataclass(frozen=True, eq=False, repr=False)
class Correction:
    """A frame in its true colors.

    image: J at the input's bit depth; where the range is unknown see ``unknown``.
    unknown: True where no range was known. unrecoverable: True where a channel's gain hit its noise-tied cap, or the camera had
    clipped a channel. clipped_fraction: fraction of valid pixels with a channel at full scale. water: the water that was taken out.
    exposure, highlights: as a Water's.
    linear: (H, W, 3) float32 linear light, unclipped, where it was asked for.
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
        known, lost = 1 - float(self.unknown.sum()) / pixels, float(self.unrecoverable.sum()) / pixels
        fractions = f"{known:.1%} known, {self.clipped_fraction:.2%} clipped, {lost:.1%} unrecoverable"
        return f"Correction({tuple(self.image.shape)} {self.image.dtype}, {fractions}, exposure {self.exposure:.3g})"

    def with_linear(self, linear: NDArray[np.float32]) -> "Correction":
        """The same correction with its linear light, (H, W, 3) float32."""
        return replace(self, linear=linear)

    def one_band(self) -> "Correction":
        """The same correction of a monochrome camera's image: green, the middle of its band, in all three channels."""
        linear = None if self.linear is None else self.linear[..., [1, 1, 1]]
        return replace(self, image=self.image[..., [1, 1, 1]], linear=linear)


@dataclass(frozen=True, eq=False)
class FrameResult:
    """A pair through all stages: the rectified pair, its range map, its colors; seconds a stage."""

    frame: StereoFrame
    range_map: RangeMap
    correction: Correction
    seconds: dict[str, float]

    @property
    def warnings(self) -> tuple[str, ...]:
        """All that the stages had to say about this pair."""
        return self.range_map.warnings + self.correction.warnings


@dataclass(frozen=True, eq=False)
class SurveyFrame:
    """A finished pair as the map sees it: corrected colors and ranges of the rectified left camera.

    name: as in StereoFrame. color: (H, W, 3) uint8 RGB. range_m, range_std_m: Map, measured pixels only.
    confidence: (H, W) uint8, 0..255 for 0..1 as in its file; 0 where unknown.
    unrecoverable: True where the water left too little of a color, None where nothing is known of that.
    """

    name: str
    timestamp_s: float | None
    color: NDArray[np.uint8]
    range_m: Map
    range_std_m: Map
    confidence: NDArray[np.uint8]
    unrecoverable: Mask | None = None

    def scaled(self, scale: float) -> "SurveyFrame":
        """With ranges scaled by this factor: of a rig whose scale is known better than by its calibration."""
        factor = np.float32(scale)
        return self if scale == 1 else replace(self, range_m=factor * self.range_m, range_std_m=factor * self.range_std_m)

    @cached_property
    def color_is_doubtful(self) -> Mask:
        """True where a channel is clipped, or could not be recovered."""
        r, g, b = (np.ascontiguousarray(self.color[..., c]) for c in range(3))  # minima over the last axis take ten times as long
        clipped = (np.maximum(np.maximum(r, g), b) >= 254) | (np.minimum(np.minimum(r, g), b) == 0)
        doubtful: Mask = clipped if self.unrecoverable is None else clipped | self.unrecoverable
        return doubtful


@dataclass(frozen=True)
class GeoOrigin:
    """Where the map's (0, 0, 0) lies: WGS84 degrees, at the water's surface (z is minus the depth).

    utm_epsg: the UTM zone whose eastings and northings the map's x and y are; the degrees are then those of a place in the survey,
    and not of (0, 0). None: x and y are meters east and north of it.
    """

    latitude_deg: float
    longitude_deg: float
    utm_epsg: int | None = None


@dataclass(frozen=True, eq=False)
class Trajectory:
    """Where the left camera stood: p_world = T_world_camera @ p_camera, meters.

    names: (N,) frame names ("" where the file names none). timestamps_s: (N,) float64, NaN where the file holds no time.
    T_world_camera: (N, 4, 4) float64; camera axes x right, y down, z forward; world east-north-up when georeferenced.
    up: "z" where the world's z axis points up; "unknown" where the format does not say (KITTI: the first camera's axes).
    origin: where the world's origin lies on Earth, None for a local map.
    camera: "rectified" where the poses are the rectified left camera's; "raw" where they are those of the camera as it was
    calibrated and mounted, which rectification turns.
    fixes: True for positions alone, such as a buoy's: heights and attitudes mean nothing.
    """

    names: tuple[str, ...]
    timestamps_s: NDArray[np.float64]
    T_world_camera: NDArray[np.float64]
    up: Literal["z", "unknown"] = "z"
    origin: GeoOrigin | None = None
    camera: Literal["raw", "rectified"] = "rectified"
    fixes: bool = False

    def of_rectified(self, T_rectified_left: NDArray[np.float64]) -> "Trajectory":
        """The same track as the rectified camera's. T_rectified_left: (4, 4), from the raw left camera's axes."""
        if self.camera == "rectified":
            return self
        return replace(self, T_world_camera=self.T_world_camera @ np.linalg.inv(T_rectified_left), camera="rectified")


Status = Literal["ok", "failed", "unpaired", "pending"]
"""pending: a stopped run did not come to it."""


@dataclass(frozen=True, slots=True)
class FrameRow:
    """The outcome of one pair, or of one file without a partner.

    kept: an earlier run had finished it. hashes: SHA-256 of its files, by side. seconds: a stage's name -> seconds.
    facts: fractions and parameters, by column.
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
        """The outcome, for a person: the name once, also where the error begins with it."""
        return f"{self.status}: {self.name}: {self.error.removeprefix(f'{self.name}: ')}"

    def then(self, later: "FrameRow") -> "FrameRow":
        """This row after a later stage: times add up, what a stage says again is said once, kept only if both were."""
        seconds = {key: self.seconds.get(key, 0.0) + later.seconds.get(key, 0.0) for key in self.seconds | later.seconds}
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
