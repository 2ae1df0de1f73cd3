"""Algebra of matrices (3, 3) for compiled loops over points."""

from typing import Any

from stereo_seecolor.compute.compiled import compiled


@compiled
def invert_symmetric(V: Any, inverse: Any) -> None:
    """Write the inverse of V (3, 3), symmetric; zeros where it has none that is positive."""
    inverse[0, 0] = V[1, 1] * V[2, 2] - V[1, 2] * V[1, 2]
    inverse[0, 1] = V[0, 2] * V[1, 2] - V[0, 1] * V[2, 2]
    inverse[0, 2] = V[0, 1] * V[1, 2] - V[0, 2] * V[1, 1]
    inverse[1, 1] = V[0, 0] * V[2, 2] - V[0, 2] * V[0, 2]
    inverse[1, 2] = V[0, 1] * V[0, 2] - V[0, 0] * V[1, 2]
    inverse[2, 2] = V[0, 0] * V[1, 1] - V[0, 1] * V[0, 1]
    inverse[1, 0], inverse[2, 0], inverse[2, 1] = inverse[0, 1], inverse[0, 2], inverse[1, 2]
    determinant = V[0, 0] * inverse[0, 0] + V[0, 1] * inverse[0, 1] + V[0, 2] * inverse[0, 2]
    for i in range(3):
        for j in range(3):
            inverse[i, j] = inverse[i, j] / determinant if determinant > 0 else 0.0
