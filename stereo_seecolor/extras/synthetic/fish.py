"""Fish, which swim between the cameras and the reef, and are elsewhere in the next frame."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calibration.transforms import transform_points
from stereo_seecolor.compute.compiled import compiled
from stereo_seecolor.extras.synthetic.casting import in_rows
from stereo_seecolor.extras.synthetic.survey import SurveySpec
from stereo_seecolor.records import Mask


@dataclass(frozen=True, eq=False)
class School:
    """The positions of the fish at one moment.

    centers_m: (n, 3) world. axes: (n, 3, 3), rows along a fish's length, height and width, each
    over half its extent.
    """

    centers_m: NDArray[np.float64]
    axes: NDArray[np.float64]

    @classmethod
    def around(cls, spec: SurveySpec, T_world_camera: NDArray[np.float64], index: int) -> "School":
        """``spec.fish`` fish in front of the camera, placed again for every pair: they move."""
        rng = np.random.default_rng([spec.seed, 5, index])
        ahead = np.stack(
            [
                rng.uniform(-0.5, 0.5, spec.fish),
                rng.uniform(-0.4, 0.4, spec.fish),
                np.ones(spec.fish),
            ],
            axis=1,
        )
        distance_m = rng.uniform(0.55, 0.8, (spec.fish, 1)) * T_world_camera[2, 3]
        centers_m = transform_points(T_world_camera, ahead * distance_m)
        heading, half_length_m = (
            rng.uniform(0, 2 * np.pi, spec.fish),
            rng.uniform(0.04, 0.10, spec.fish),
        )
        axes = np.zeros((spec.fish, 3, 3))
        for axis, angle, slimness in ((0, 0.0, 1.0), (2, np.pi / 2, 0.22)):
            axes[:, axis, 0] = np.cos(heading + angle) / (half_length_m * slimness)
            axes[:, axis, 1] = np.sin(heading + angle) / (half_length_m * slimness)
        axes[:, 1, 2] = 1 / (0.42 * half_length_m)
        return cls(centers_m, axes)

    def cover(
        self,
        T_world_camera: NDArray[np.float64],
        rays: NDArray[np.float32],
        range_m: NDArray[np.float32],
        color: NDArray[np.float32],
    ) -> Mask:
        """Write range and color of the fish over the rest; (H, W, S) True where a fish is."""
        moving = np.zeros(range_m.shape, np.bool_)
        if len(self.centers_m):
            in_rows(
                _cover,
                len(rays),
                self.centers_m,
                self.axes,
                T_world_camera,
                rays,
                range_m,
                color,
                moving,
            )
        return moving


@compiled
def _cover(
    first: int,
    end: int,
    centers_m: Any,
    axes: Any,
    pose: Any,
    rays: Any,
    range_m: Any,
    color: Any,
    moving: Any,
) -> None:
    """First crossing of each ray with each ellipsoid |axes (p - center)| = 1."""
    _, columns, samples = range_m.shape
    for i in range(first, end):
        ray, from_center, direction = np.empty(3), np.empty(3), np.empty(3)
        for j in range(columns):
            for s in range(samples):
                for k in range(3):
                    ray[k] = (
                        pose[k, 0] * rays[i, j, s, 0]
                        + pose[k, 1] * rays[i, j, s, 1]
                        + pose[k, 2] * rays[i, j, s, 2]
                    )
                for f in range(len(centers_m)):
                    for k in range(3):
                        from_center[k], direction[k] = 0.0, 0.0
                        for m in range(3):
                            from_center[k] += axes[f, k, m] * (pose[m, 3] - centers_m[f, m])
                            direction[k] += axes[f, k, m] * ray[m]
                    a = (direction**2).sum()
                    b = (from_center * direction).sum()
                    root = b * b - a * ((from_center**2).sum() - 1.0)
                    if root <= 0.0:
                        continue
                    reach = (-b - np.sqrt(root)) / a
                    if 0.0 < reach < range_m[i, j, s]:
                        range_m[i, j, s] = reach
                        moving[i, j, s] = True
                        along, high = (
                            from_center[0] + reach * direction[0],
                            from_center[1] + reach * direction[1],
                        )
                        silver = (0.35 + 0.2 * high) * (0.75 + 0.25 * np.sign(np.sin(9.0 * along)))
                        color[i, j, s, 0] = silver
                        color[i, j, s, 1] = 0.9 * silver
                        color[i, j, s, 2] = 0.45 * silver if along < 0.4 else 0.9 * silver
