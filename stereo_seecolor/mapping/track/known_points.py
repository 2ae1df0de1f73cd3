"""What is known of points in the world, as factors of GTSAM: how far middles of points are apart, and where they lie."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.mapping.track.pose_graph import gtsam_library

Array = NDArray[np.float64]


@dataclass(frozen=True)
class KnownLength:
    """Between the middle of some points and that of others, by their numbers; meters, with its standard error."""

    first: tuple[int, ...]
    second: tuple[int, ...]
    length_m: float
    std_m: float

    def factor(self, first_key: int) -> Any:
        """Of points whose keys are their numbers after first_key."""
        count = len(self.first)

        def off(this: Any, values: Any, jacobians: list[Array] | None) -> Array:
            points = np.array([values.atPoint3(key) for key in this.keys()])  # noqa: SIM118
            apart = points[:count].mean(axis=0) - points[count:].mean(axis=0)
            length = float(np.linalg.norm(apart))
            if jacobians is not None:
                for k in range(len(points)):
                    part = 1 / count if k < count else -1 / (len(points) - count)
                    jacobians[k] = part * apart[None] / length
            return np.array([length - self.length_m])

        return _factor((*self.first, *self.second), first_key, self.std_m, 1, off)


@dataclass(frozen=True, eq=False)
class KnownPlace:
    """Of the middle of some points: (3,) meters in the world, with the standard error of each axis."""

    points: tuple[int, ...]
    place_m: Array
    std_m: float

    def factor(self, first_key: int) -> Any:
        """Of points whose keys are their numbers after first_key."""

        def off(this: Any, values: Any, jacobians: list[Array] | None) -> Array:
            points = np.array([values.atPoint3(key) for key in this.keys()])  # noqa: SIM118
            if jacobians is not None:
                for k in range(len(points)):
                    jacobians[k] = np.eye(3) / len(points)
            return np.asarray(points.mean(axis=0) - self.place_m)

        return _factor(self.points, first_key, self.std_m, 3, off)


Known = KnownLength | KnownPlace


def _factor(points: tuple[int, ...], first_key: int, std_m: float, rows: int, off: Any) -> Any:
    gtsam = gtsam_library()
    return gtsam.CustomFactor(gtsam.noiseModel.Isotropic.Sigma(rows, std_m), [first_key + point for point in points], off)
