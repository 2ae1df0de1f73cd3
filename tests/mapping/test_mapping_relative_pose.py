"""The fit of a relative pose: its residuals and normal equations against the model of
``image_space`` and its derivatives.
"""

import numpy as np
import pytest

from calibration.transforms import rigid_transform, rotation_from_vector
from stereo_seecolor.mapping.track.image_space import Observed, move
from stereo_seecolor.mapping.track.relative_pose import SETTINGS, residuals


def test_the_normal_equations_are_those_of_the_model() -> None:
    rng, count, sigmas = np.random.default_rng(0), 200, SETTINGS.outlier_sigmas
    T = rigid_transform(
        rotation_from_vector(np.array([0.1, -0.2, 0.3])), np.array([0.3, -0.1, 0.2])
    )
    b = np.column_stack([rng.uniform(-0.5, 0.5, (count, 2)), rng.uniform(0.3, 0.8, count)])
    a = move(T, b).points + rng.normal(0, 0.003, (count, 3))
    a_std, b_std = rng.uniform(5e-4, 2e-3, (2, count, 3))
    squared, H, g = residuals(T, Observed(a, a_std), Observed(b, b_std))

    moved = move(T, b)
    residual, by_point = a - moved.points, moved.by_point * b_std[:, None, :]
    weight = np.linalg.inv(
        by_point @ np.swapaxes(by_point, 1, 2) + a_std[:, :, None] ** 2 * np.eye(3)
    )
    expected = np.einsum("ni,nij,nj->n", residual, weight, residual)
    robust = weight / (1 + expected / sigmas**2)[:, None, None]
    assert squared == pytest.approx(expected)
    model = np.einsum("nki,nkl,nlj->ij", moved.by_pose, robust, moved.by_pose)
    assert pytest.approx(model) == H
    assert g == pytest.approx(np.einsum("nki,nkl,nl->i", moved.by_pose, robust, residual))
