"""A small form of benchmarks/standard_errors.py: three frames of the sample dive, and its map."""

import runpy
import sys
from pathlib import Path

import numpy as np
import pytest
from conftest import SampleRun

ROOT = Path(__file__).resolve().parents[3]
REEF = ROOT / "data_samples/reef"
sys.path.append(str(ROOT / "benchmarks"))  # scripts import each other
BENCHMARK = runpy.run_path(str(ROOT / "benchmarks/standard_errors.py"))


@pytest.mark.slow
def test_lengths_and_areas_lie_within_their_standard_errors(sample_run: SampleRun) -> None:
    both = BENCHMARK["surfaces"](REEF, sample_run.out)[::5]
    for part in (BENCHMARK["lengths"](both, 150, 1), BENCHMARK["areas"](both, 40, 1)):
        for name, scores in part.items():
            z = np.array(scores)
            assert np.mean(np.abs(z) <= 2) >= 0.9, name
            assert abs(z.mean()) < 0.4 and np.abs(z).max() < 5, name
            assert z.std() > 0.6, f"{name}: the stated error is much too large"


@pytest.mark.slow
def test_heights_structure_and_mounds_lie_within_their_standard_errors(
    mapped_by_poses: Path,
) -> None:
    rng = np.random.default_rng(1)
    at = BENCHMARK["mapped"](REEF, mapped_by_poses)  # in the coordinates of the truth
    found = {
        **BENCHMARK["heights"](at, 20, rng),
        **BENCHMARK["structures"](at, 30, rng),
        **BENCHMARK["outlines"](at, 35, rng),
    }
    for name in ("height of a cell", "volume_l of a mound", "rugosity_area of squares"):
        z = np.array(found[name])
        assert len(z) >= 30 and np.mean(np.abs(z) <= 2) >= 0.85, name
        assert abs(z.mean()) < 0.6 and z.std() > 0.4, name
