"""Positions that are read rightly and are off: their scale and their jumps are told against the
pictures, noise is not.
"""

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from calibration.transforms import inverse, rigid_transform, rotation_from_vector
from stereo_seecolor.mapping.frame_index import FrameIndex
from stereo_seecolor.mapping.navigation.deviations import deviations
from stereo_seecolor.mapping.track.relative_pose import Edge

Poses = NDArray[np.float64]
FRAMES = 24
NOBODY = (np.zeros((0, 3), np.float32),) * FRAMES
INDEX = FrameIndex(
    tuple(f"f{i:02}" for i in range(FRAMES)), np.arange(FRAMES)[::-1].astype(float), NOBODY
)
"""Files are named against the order of time."""


def true_poses() -> Poses:
    """A track of two bends, 0.3 m a frame."""
    along = 0.3 * np.arange(FRAMES)
    R = rotation_from_vector(np.stack([0 * along, 0 * along, 0.4 * np.sin(along)], axis=1))
    places = np.stack([along, np.sin(along), 0 * along], axis=1)
    return np.stack([rigid_transform(*one) for one in zip(R, places, strict=True)])[::-1].copy()


def edges() -> list[Edge]:
    """As the pictures show them, to a millimeter; each frame against the three that follow."""
    T, rng = true_poses(), np.random.default_rng(5)
    found = []
    for i, j in ((i, i + step) for step in (1, 2, 3) for i in range(FRAMES - step)):
        measured = inverse(T[i]) @ T[j]
        measured[:3, 3] += rng.normal(0, 0.001, 3)
        found.append(Edge(i, j, measured, np.eye(6), 100))
    return found


def told(change: Callable[[Poses], None]) -> list[str]:
    T = true_poses()
    change(T)
    return deviations(T, edges(), INDEX)


def scaled(factor: float) -> Callable[[Poses], None]:
    def change(T: Poses) -> None:
        T[:, :3, 3] *= factor

    return change


def noisy(position_m: float, attitude_deg: float, seed: int) -> Callable[[Poses], None]:
    def change(T: Poses) -> None:
        rng = np.random.default_rng(seed)
        T[:, :3, 3] += rng.normal(0, position_m, (FRAMES, 3))
        T[:, :3, :3] = T[:, :3, :3] @ rotation_from_vector(
            rng.normal(0, np.radians(attitude_deg), (FRAMES, 3))
        )

    return change


def jumping(T: Poses) -> None:
    T[:10, :3, 3] += [0.5, -0.5, 0.0]


@pytest.mark.parametrize("factor", [1.05, 0.95])
def test_a_scale_is_told_with_its_standard_error(factor: float) -> None:
    (line,) = told(scaled(factor))
    assert line.startswith(f"the given positions are {factor:.3f} ± 0.00")


def test_a_jump_is_told_with_its_place() -> None:
    assert told(jumping) == [
        "the given positions jump by 0.71 m relative to the images between f10 and f09"
    ]


@pytest.mark.parametrize("frame", [5, 12])
def test_a_single_position_is_told_by_its_frame(frame: int) -> None:
    def change(T: Poses) -> None:
        T[frame, :3, 3] += [0.3, 0.4, 0.0]

    assert told(change) == [
        f"the given position of f{frame:02} is 0.50 m off relative to the images"
    ]


def test_a_jump_is_told_beside_a_scale_and_among_noise() -> None:
    def both(T: Poses) -> None:
        jumping(T)
        scaled(1.1)(T)

    def among_noise(T: Poses) -> None:
        jumping(T)
        noisy(0.03, 2, 1)(T)

    assert len(told(both)) == 2
    assert "between f10 and f09" in told(among_noise)[0]


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(
    ("position_m", "attitude_deg"), [(0.0, 0.0), (0.05, 2.0), (0.2, 5.0), (0.003, 15.0)]
)
def test_noise_is_neither(position_m: float, attitude_deg: float, seed: int) -> None:
    assert told(noisy(position_m, attitude_deg, seed)) == []


def test_few_edges_tell_nothing() -> None:
    T = true_poses()
    jumping(T)
    assert deviations(T, edges()[:7], INDEX) == []
