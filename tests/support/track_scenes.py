"""Frames with what makes a track come out short or long: light that travels with the camera, a lens
that is not as calibrated, ranges that are noisy far away.
"""

import dataclasses

import cv2
import numpy as np
from mapping_scene import ReefFrames
from numpy.typing import NDArray

from calibration import RectifiedPair
from calibration.transforms import inverse
from stereo_seecolor.extras.synthetic.reef_light import LAMP_BEAM_EXPONENT, LAMPS_M, lamp_pattern
from stereo_seecolor.mapping.frame_index import FrameIndex
from stereo_seecolor.mapping.survey import Survey
from stereo_seecolor.mapping.track import odometry
from stereo_seecolor.mapping.track.relative_pose import Edge
from stereo_seecolor.records import SurveyFrame, Trajectory

Array = NDArray[np.float64]


def lit_by_lamps(frame: SurveyFrame, pair: RectifiedPair, contrast: float) -> SurveyFrame:
    """The frame at night: lit only by the rig's lamps, whose beams have a pattern, exposed for its
    median.
    """
    points_m = (_rays(pair) * (frame.range_m / pair.ray_length)[..., None]).astype(np.float32)
    light = np.zeros(frame.range_m.shape)
    for lamp_m in LAMPS_M:
        away = points_m - lamp_m.astype(np.float32)
        distance_m = np.linalg.norm(away, axis=-1)
        light += (
            (away[..., 2] / distance_m) ** LAMP_BEAM_EXPONENT
            / distance_m**2
            * lamp_pattern(contrast, away)
        )
    linear = (frame.color / 255.0) ** 2.2 * (light / np.nanmedian(light))[..., None]
    return dataclasses.replace(
        frame, color=np.clip(np.rint(255 * linear ** (1 / 2.2)), 0, 255).astype(np.uint8)
    )


def through_another_lens(frame: SurveyFrame, pair: RectifiedPair, corner_px: float) -> SurveyFrame:
    """The frame as a lens shows it whose calibration is off radially, by so many pixels in the
    corner.
    """
    directions = _rays(pair)[..., :2].astype(np.float64)
    corner = np.hypot(*pair.image_size) / 2 / pair.focal_px
    true = directions * (
        1 - corner_px / pair.focal_px / corner**3 * (directions**2).sum(-1, keepdims=True)
    )
    x, y = (
        (true * pair.focal_px + [pair.cx_left_px, pair.cy_px]).astype(np.float32).transpose(2, 0, 1)
    )
    depth_m = cv2.remap(
        frame.range_m / pair.ray_length, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
    )
    color = cv2.remap(frame.color, x, y, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
    return dataclasses.replace(
        frame, color=color, range_m=(depth_m * pair.ray_length).astype(np.float32)
    )


def with_noisy_disparities(
    frame: SurveyFrame, pair: RectifiedPair, noise_px: float, seed: int
) -> SurveyFrame:
    """The frame's exact ranges with noise of the disparity: far ranges are the noisier, and more
    often too long than too short.
    """
    noise = cv2.GaussianBlur(
        np.random.default_rng(seed).standard_normal(frame.range_m.shape), (0, 0), 1.5
    )
    disparity = pair.focal_px * pair.baseline_m * pair.ray_length / frame.range_m
    noisy = disparity + noise_px * noise / noise.std()
    range_m = np.where(
        noisy > 0, pair.focal_px * pair.baseline_m * pair.ray_length / noisy, np.nan
    ).astype(np.float32)
    std_m = (noise_px * range_m**2 / (pair.focal_px * pair.baseline_m * pair.ray_length)).astype(
        np.float32
    )
    return dataclasses.replace(frame, range_m=range_m, range_std_m=std_m)


def followed(frames: list[SurveyFrame], pair: RectifiedPair) -> list[Edge]:
    """The edges of a track."""
    return odometry.follow(Survey(frames, pair, FrameIndex.build(frames, pair))).edges


def scale(edges: list[Edge], truth: Trajectory, gap: int) -> float:
    """Length of the measured shifts between frames so far apart over the true ones, along those."""
    T = truth.T_world_camera
    chosen = [e for e in edges if abs(e.j - e.i) == gap]
    assert len(chosen) >= 4
    true = np.array([(inverse(T[e.i]) @ T[e.j])[:3, 3] for e in chosen])
    measured = np.array([e.T_i_j[:3, 3] for e in chosen])
    return float((true * measured).sum() / (true**2).sum())


def exact(reef: ReefFrames) -> list[SurveyFrame]:
    """All frames of a reef."""
    return [reef[i] for i in range(len(reef))]


def _rays(pair: RectifiedPair) -> NDArray[np.float32]:
    width, height = pair.image_size
    column, row = np.meshgrid(np.arange(width), np.arange(height))
    x, y = (column - pair.cx_left_px) / pair.focal_px, (row - pair.cy_px) / pair.focal_px
    return np.stack([x, y, np.ones_like(x)], -1).astype(np.float32)
