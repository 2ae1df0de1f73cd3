"""The formulas of water: closed forms, the same for numpy and torch, and written in one place."""

import re
from pathlib import Path

import numpy as np
import pytest
import torch

from stereo_seecolor.color.fitting.robust import fit_all, quality
from stereo_seecolor.color.table.counting import measure
from stereo_seecolor.color.table.range_quantiles import quantiles_by_range
from stereo_seecolor.config import ColorConfig, RobustConfig
from stereo_seecolor.water import physics

PACKAGE = Path(__file__).resolve().parents[2] / "stereo_seecolor"


@pytest.mark.parametrize(
    "formula", [physics.backscatter, physics.attenuation, physics.optical_depth]
)
def test_numpy_and_torch_agree(formula) -> None:
    z, rng = np.linspace(0, 30, 100), np.random.default_rng(0)
    numbers = rng.uniform(0.01, 1, 4)
    in_torch = formula(torch.from_numpy(z), *map(torch.tensor, numbers))
    np.testing.assert_allclose(formula(z, *numbers), in_torch, rtol=1e-14)


def test_closed_forms() -> None:
    z = np.array([0.0, 1.0, 2.5])
    np.testing.assert_allclose(physics.ged(np.array([-2.0, 0.0, 1.5])), [1, 1, np.exp(-1.5)])
    np.testing.assert_allclose(physics.cged(np.array([-2.0, 0.0, 1.5])), [0, 0, 1 - np.exp(-1.5)])
    np.testing.assert_allclose(
        physics.backscatter(z, 0.3, 0.7, 0.1, 0.4),
        0.3 * (1 - np.exp(-0.7 * z)) + 0.1 * np.exp(-0.4 * z),
    )
    np.testing.assert_allclose(
        physics.attenuation(z, 0.2, 0.3, 0.1, 0.0), np.exp(-z * (0.2 * np.exp(-0.3 * z) + 0.1))
    )


FORMULAS = {
    r"exp\(\s*-(?!self)[^)]*(range_m|\bz\b)|expm1\(-[^aE]": 0,  # decays of range: water/physics.py
    r"4 \* noise": 1,  # light that does not stand out of the noise
    r"length \+ over": 1,  # the roll-off of highlights
    # J = gain I - offset: of pixels, and of the rows of a look-up table
    r"gain\b.* \* .*decoded": 2,
    r"lost \* ": 1,  # what the camera clipped
}
"""What only a formula holds, and in how many lines of the package color it stands."""


@pytest.mark.parametrize("formula", FORMULAS)
def test_a_formula_is_written_once(formula: str) -> None:
    lines = []
    for path in sorted((PACKAGE / "color").rglob("*.py")):
        code = re.sub(r'""".*?"""|#[^\n]*', "", path.read_text(), flags=re.DOTALL)
        lines += [
            f"{path.name}: {line.strip()}" for line in code.splitlines() if re.search(formula, line)
        ]
    assert len(lines) == FORMULAS[formula], lines


def tables() -> list:
    rng = np.random.default_rng(3)
    found = []
    for far_m in (2.0, 4.0, 7.0):
        range_m = np.broadcast_to(
            np.linspace(1, far_m, 120, dtype=np.float32)[:, None], (120, 160)
        ).copy()
        light = rng.beta(1, 3, (120, 160, 3)) * np.exp(
            -range_m[..., None] * [0.4, 0.12, 0.1]
        ) + 0.1 * (1 - np.exp(-0.3 * range_m[..., None]))
        found.append(
            quantiles_by_range(
                measure(np.round(255 * light.clip(0, 1)).astype(np.uint8), range_m), "srgb"
            )
        )
    narrow = np.full((120, 160), 1.5, np.float32)  # one range: the others are padded to it
    found.append(
        quantiles_by_range(
            measure(rng.integers(0, 200, (120, 160, 3)).astype(np.uint8), narrow), "srgb"
        )
    )
    return found


@pytest.mark.slow
def test_a_batch_of_frames_is_fitted_as_each_alone() -> None:
    config, seen = ColorConfig(), tables()
    together, _ = fit_all(seen, config)
    for frame, water in zip(seen, together, strict=True):
        (alone,), _ = fit_all([frame], config)
        for name in ("y", "w", "beta", "gamma_inf", "white"):
            np.testing.assert_allclose(
                getattr(water, name), getattr(alone, name), rtol=1e-6, atol=1e-9
            )
    costs = quality(seen, RobustConfig(), together)
    np.testing.assert_allclose(
        costs,
        [
            quality([frame], RobustConfig(), [water])[0]
            for frame, water in zip(seen, together, strict=True)
        ],
        rtol=1e-6,
    )


def test_the_fit_has_converged() -> None:
    """Restarted from its end it moves no parameter by a thousandth: the fit of before moved by up
    to 2 % on such frames.
    """
    config = ColorConfig()
    for frame in tables()[:3]:
        (water,), _ = fit_all([frame], config)
        (again,), _ = fit_all([frame], config, [water])
        for name in ("y", "beta", "gamma_inf", "white"):
            np.testing.assert_allclose(getattr(again, name), getattr(water, name), rtol=1e-3)
