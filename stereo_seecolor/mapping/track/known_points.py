"""Knowledge of points in the world: the distance between means of points, and the position of such
a mean.
"""

from dataclasses import dataclass

import numpy as np

from stereo_seecolor.records import Array


@dataclass(frozen=True)
class KnownLength:
    """The distance between means of two groups of points; meters, with its standard error."""

    first: tuple[int, ...]
    second: tuple[int, ...]
    length_m: float
    std_m: float

    @property
    def points(self) -> tuple[int, ...]:
        """All points of both means."""
        return self.first + self.second

    def off(self, places: Array) -> tuple[Array, Array]:
        """Compute the error of the length between ``points`` at places (k, 3), (1,) in standard
        errors, and its slope (1, 3 k).
        """
        count = len(self.first)
        apart = places[:count].mean(axis=0) - places[count:].mean(axis=0)
        length = float(np.linalg.norm(apart))
        shares = np.repeat([1 / count, -1 / (len(places) - count)], [count, len(places) - count])
        return np.array([(self.length_m - length) / self.std_m]), np.kron(shares, apart / length)[
            None
        ] / self.std_m


@dataclass(frozen=True, eq=False)
class KnownPlace:
    """The position of the mean of some points: (3,) meters, with each axis's standard error."""

    points: tuple[int, ...]
    place_m: Array
    std_m: float

    def off(self, places: Array) -> tuple[Array, Array]:
        """Compute the error of the mean of ``points`` at places (k, 3), (3,) in standard errors,
        and the mean's slope (3, 3 k).
        """
        slope = np.tile(np.eye(3) / len(places), len(places))
        return (self.place_m - places.mean(axis=0)) / self.std_m, slope / self.std_m


Known = KnownLength | KnownPlace
