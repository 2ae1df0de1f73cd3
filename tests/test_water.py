"""The whole way on the sample dive: run, measure the water from overlapping frames, run again with it."""

import json
from pathlib import Path

import numpy as np
import pytest
from conftest import SampleRun

from stereo_seecolor.commands.evaluate import evaluate
from stereo_seecolor.commands.run import run
from stereo_seecolor.commands.water import measure_water
from stereo_seecolor.config_file import load_config
from stereo_seecolor.errors import InputError
from stereo_seecolor.progress import RunOptions

SAMPLES = Path(__file__).parents[1] / "data_samples" / "reef"
SIDES = (SAMPLES / "left", SAMPLES / "right", str(SAMPLES / "cam.yaml"))


@pytest.mark.slow
def test_sample_dive_measures_its_own_water(sample_run: SampleRun, tmp_path: Path) -> None:
    """Attenuation within 10 % of truth from matched ranges, and colors no worse for it."""
    config = load_config(overrides=["color.lock=survey", "output.clouds=false"])
    run(*SIDES, sample_run.copy(tmp_path / "first"), config)
    measured = measure_water(tmp_path / "first", SAMPLES / "trajectory.tum")
    path, found = measured.path, measured.water
    truth = json.loads((SAMPLES / "truth" / "water.json").read_bytes())["water"]
    z = 2.0
    np.testing.assert_allclose(
        -np.log(found.attenuation(np.array(z))) / z, np.array(truth["w"]) * np.exp(-np.array(truth["v"]) * z), rtol=0.1
    )
    run(*SIDES, sample_run.copy(tmp_path / "second"), config, RunOptions(water=path))
    first, second = (evaluate(tmp_path / name, SAMPLES / "truth") for name in ("first", "second"))
    assert second.color.angle_deg < first.color.angle_deg + 0.3
    assert second.color.angle_after_gains_deg < first.color.angle_after_gains_deg + 0.1


@pytest.mark.slow
def test_a_run_with_a_water_for_each_frame_is_refused(waters_a_frame: Path) -> None:
    with pytest.raises(InputError, match=r"color\.lock=survey"):
        measure_water(waters_a_frame, SAMPLES / "trajectory.tum")
