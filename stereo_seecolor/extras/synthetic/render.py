"""A pair of images of the reef, lit by sun and lamps, seen through the water, with the truth."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration import Camera, Rectification, StereoRig
from calibration.transforms import rigid_transform
from stereo_seecolor.compute.compiled import compiled
from stereo_seecolor.extras.synthetic.casting import Rays, cast, in_rows, look_up
from stereo_seecolor.extras.synthetic.fish import School
from stereo_seecolor.extras.synthetic.reef import Reef, build_reef
from stereo_seecolor.extras.synthetic.reef_light import (
    caustics,
    lamplight,
    strobe_energy,
    sunlight,
    vignetting,
)
from stereo_seecolor.extras.synthetic.sensor import expose
from stereo_seecolor.extras.synthetic.survey import SurveySpec, rig, track
from stereo_seecolor.extras.synthetic.waters import LitWater, lit_water
from stereo_seecolor.files.srgb import encode_srgb
from stereo_seecolor.records import Image, Mask, RangeMap, StereoFrame, Trajectory

_GRID = 2
"""Samples a pixel, each way."""
_TABLE_STEP_M = 0.002


@dataclass(frozen=True, eq=False)
class RenderedPair:
    """A pair as the cameras took it, and what is true of the rectified left image.

    frame: the raw pair, distorted, not rectified. rectified: the same pair after rectification.
    range_map: exact, NaN where the camera looks past the reef. color: (H, W, 3) linear color of the
    lit reef without water (albedo times shading, 1 = white in full light). visible: pixels that the
    right camera sees too.
    moving: pixels on fish.
    T_world_camera: (4, 4) of the rectified left camera.
    """

    frame: StereoFrame
    rectified: StereoFrame
    range_map: RangeMap
    color: NDArray[np.float32]
    visible: Mask
    moving: Mask
    T_world_camera: NDArray[np.float64]

    @property
    def color_image(self) -> Image:
        """``color`` as an image of the frame's own encoding: 8-bit sRGB, or 16-bit linear."""
        clipped = np.clip(self.color, 0.0, 1.0)
        if self.frame.left.dtype == np.uint16:
            return np.round(clipped * 65535.0).astype(np.uint16)
        return np.round(encode_srgb(clipped) * 255.0).astype(np.uint8)


@dataclass(frozen=True, eq=False)
class _Instant:
    """When a pair is taken. rig_pose: (4, 4) of the rig in the world, with its lamps. school: the
    fish as they swim then.

    strobe: factor on the lamps' usual energy.
    """

    rig_pose: NDArray[np.float64]
    school: School
    time_s: float
    strobe: float


@dataclass(frozen=True, eq=False)
class Scene:
    """A survey's scene: built once, then ``render(index)`` for each pair."""

    spec: SurveySpec
    reef: Reef
    rig: StereoRig
    rectification: Rectification
    trajectory: Trajectory
    water: LitWater

    @classmethod
    def from_spec(cls, spec: SurveySpec) -> "Scene":
        """The reef, the rig, the track and the water of a survey."""
        stereo_rig = rig(spec)
        camera_depth_m = spec.bottom_depth_m - float(np.mean(spec.altitude_m))
        encoding: Literal["srgb", "linear"] = "srgb" if spec.bits == 8 else "linear"
        lamps = spec.lamp_intensity / spec.exposure_range_m**2
        water = lit_water(
            spec.water, spec.bottom_depth_m, camera_depth_m, spec.exposure_range_m, lamps, encoding
        )
        return cls(
            spec,
            build_reef(spec),
            stereo_rig,
            Rectification.from_rig(stereo_rig),
            track(spec),
            water,
        )

    def render(self, index: int) -> RenderedPair:
        """The pair taken at pose ``index`` of the track, and what is true of it."""
        pose = self.trajectory.T_world_camera[index]
        frame, apply = self.photograph(index), self.rectification
        rectified = replace(
            frame, left=apply.apply_left(frame.left), right=apply.apply_right(frame.right)
        )
        truth = self._truth(pose, School.around(self.spec, pose, index))
        return RenderedPair(frame, rectified, *truth, T_world_camera=pose)

    def photograph(self, index: int) -> StereoFrame:
        """Render the same pair without the truth, in half the time."""
        pose = self.trajectory.T_world_camera[index]
        time_s = float(self.trajectory.timestamps_s[index])
        instant = _Instant(
            pose, School.around(self.spec, pose, index), time_s, strobe_energy(self.spec, index)
        )
        T_world_left = pose @ rigid_transform(self.rectification.R_left, np.zeros(3))
        # another rounding of the inverse would move pixels of the sample dive
        T_world_right = T_world_left @ np.linalg.inv(self.rig.T_right_left)
        left = self._picture(T_world_left, self._rays_left, self.rig.left, instant, (index, 0))
        right = self._picture(T_world_right, self._rays_right, self.rig.right, instant, (index, 1))
        return StereoFrame(self.trajectory.names[index], left, right, time_s)

    @cached_property
    def _rays_left(self) -> Rays:
        return _raw_rays(self.rig.left)

    @cached_property
    def _rays_right(self) -> Rays:
        return _raw_rays(self.rig.right)

    @cached_property
    def _rays_rectified(self) -> Rays:
        pair = self.rectification.pair
        return _raw_rays(Camera(pair.P_left, np.zeros(0), pair.image_size))

    def _surface(
        self, T_world_camera: NDArray[np.float64], rays: Rays, focal_px: float, school: School
    ) -> tuple[NDArray[np.float32], NDArray[np.float32], Mask]:
        """Range (H, W, S), lit color (H, W, S, 3) and fish mask of what each ray meets first."""
        range_m = cast(self.reef, T_world_camera, rays)
        color = look_up(self.reef, T_world_camera, rays, range_m, 1.0 / (focal_px * _GRID))
        moving = school.cover(T_world_camera, rays, range_m, color)
        return range_m, color, moving

    def _picture(
        self,
        T_world_camera: NDArray[np.float64],
        rays: Rays,
        camera: Camera,
        instant: "_Instant",
        noise_seed: tuple[int, int],
    ) -> Image:
        range_m, color, _ = self._surface(
            T_world_camera, rays, float(camera.K[0, 0]), instant.school
        )
        points_m = _points(T_world_camera, rays, range_m)
        light = sunlight(self.water, points_m)
        if self.spec.caustic_contrast > 0:
            light *= caustics(self.spec, points_m, instant.time_s)[..., None]
        if self.spec.lamp_intensity > 0:
            light += lamplight(self.spec, self.water, points_m, instant.rig_pose) * np.float32(
                instant.strobe
            )
        transmission, backscatter = self._water_tables
        seen = np.zeros((*range_m.shape[:2], 3), np.float32)
        in_rows(_through_water, len(rays), color, light, range_m, transmission, backscatter, seen)
        if self.spec.vignette > 0:
            seen *= vignetting(self.spec)[..., None]
        rng = np.random.default_rng([self.spec.seed, 4, *noise_seed])
        return expose(seen, self.spec.full_well_e, self.spec.read_noise_e, self.spec.bits, rng)

    @cached_property
    def _water_tables(self) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """A(z) and B(z) every ``_TABLE_STEP_M`` up to 40 m; last, for rays that meet nothing."""
        range_m = np.append(np.arange(0.0, 40.0, _TABLE_STEP_M), 1e6)
        water = self.water.water
        return water.attenuation(range_m).astype(np.float32), water.backscatter(range_m).astype(
            np.float32
        )

    def _truth(
        self, pose: NDArray[np.float64], school: School
    ) -> tuple[RangeMap, NDArray[np.float32], Mask, Mask]:
        pair = self.rectification.pair
        centers = _pixel_rays(pair.P_left, pair.image_size)
        range_m, _, moving = self._surface(pose, centers, pair.focal_px, school)
        known_m = np.where(np.isfinite(range_m[..., 0]), range_m[..., 0], np.float32(np.nan))
        _, color, _ = self._surface(pose, self._rays_rectified, pair.focal_px, school)
        depth_m = pair.depth_from_range(known_m)
        disparity = pair.disparity_from_depth(depth_m)
        known = np.isfinite(known_m)
        sure = np.where(known, np.float32(0), np.float32(np.nan))
        none = np.zeros(known.shape, np.bool_)
        range_map = RangeMap(disparity, depth_m, known_m, sure, known.astype(np.float32), none)
        visible = self._seen_from_right(
            pose, _points(pose, centers, range_m)[..., 0, :], disparity, school
        )
        return range_map, color.mean(axis=2), visible, moving[..., 0]

    def _seen_from_right(
        self,
        pose: NDArray[np.float64],
        points_m: NDArray[np.float32],
        disparity: NDArray[np.float32],
        school: School,
    ) -> Mask:
        """True where nothing stands between the point and the right camera, and the point falls
        into its image.
        """
        right = np.eye(4)
        right[:3, 3] = (pose @ [self.rectification.pair.baseline_m, 0, 0, 1])[:3]
        towards = points_m - right[:3, 3].astype(np.float32)
        distance_m = np.linalg.norm(towards, axis=-1)
        rays = (towards / distance_m[..., None])[:, :, None, :].astype(np.float32)
        rays[~np.isfinite(rays)] = 0
        met_m, _, _ = self._surface(right, rays, self.rectification.pair.focal_px, school)
        width, _ = self.rectification.pair.image_size
        column = np.arange(width, dtype=np.float32) - disparity
        with np.errstate(invalid="ignore"):
            return np.asarray(
                (np.abs(met_m[..., 0] - distance_m) < 0.01) & (column >= 0) & (column <= width - 1)
            )


def _raw_rays(camera: Camera) -> Rays:
    """(H, W, S, 3) rays of _GRID x _GRID samples in every pixel, lens distortion undone."""
    width, height = camera.image_size
    offsets = (np.arange(_GRID) + 0.5) / _GRID - 0.5
    row, column, down, across = np.meshgrid(
        np.arange(height), np.arange(width), offsets, offsets, indexing="ij"
    )
    pixels = np.stack([column + across, row + down], axis=-1).reshape(-1, 1, 2)
    settled = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 30, 1e-9)
    flat = cv2.undistortPoints(pixels, camera.K, camera.distortion, criteria=settled)
    rays = np.concatenate([flat[:, 0], np.ones((len(flat), 1))], axis=1)
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    samples: Rays = rays.astype(np.float32).reshape(height, width, _GRID * _GRID, 3)
    return samples


def _pixel_rays(P: NDArray[np.float64], image_size: tuple[int, int]) -> Rays:
    """(H, W, 1, 3) the ray through each pixel's center."""
    width, height = image_size
    row, column = np.meshgrid(np.arange(height), np.arange(width), indexing="ij")
    rays = np.stack(
        [(column - P[0, 2]) / P[0, 0], (row - P[1, 2]) / P[1, 1], np.ones_like(row, np.float64)],
        axis=-1,
    )
    unit: Rays = (rays / np.linalg.norm(rays, axis=-1, keepdims=True))[:, :, None, :].astype(
        np.float32
    )
    return unit


def _points(
    T_world_camera: NDArray[np.float64], rays: Rays, range_m: NDArray[np.float32]
) -> NDArray[np.float32]:
    """World points that the rays meet; far below where they meet nothing."""
    reach = np.where(np.isfinite(range_m), range_m, np.float32(1e3))[..., None]
    turned = rays @ T_world_camera[:3, :3].T.astype(np.float32)
    return np.asarray(turned * reach + T_world_camera[:3, 3].astype(np.float32))


@compiled
def _through_water(
    first: int,
    end: int,
    color: Any,
    light: Any,
    range_m: Any,
    transmission: Any,
    backscatter: Any,
    seen: Any,
) -> None:
    """What a pixel gathers: I = J light A(z) + B(z), averaged over its samples."""
    _, columns, samples, _ = color.shape
    last = transmission.shape[0] - 1
    for i in range(first, end):
        for j in range(columns):
            for s in range(samples):
                place = min(range_m[i, j, s] / _TABLE_STEP_M, last - 1.001)
                k = int(place) if np.isfinite(range_m[i, j, s]) else last
                fraction = place - k if k < last else 0.0
                after = min(k + 1, last)
                for c in range(3):
                    a = transmission[k, c] * (1 - fraction) + transmission[after, c] * fraction
                    b = backscatter[k, c] * (1 - fraction) + backscatter[after, c] * fraction
                    seen[i, j, c] += (color[i, j, s, c] * light[i, j, s, c] * a + b) / samples
