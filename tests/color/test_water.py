"""The whole way on the sample dive: run, measure the water from overlapping frames, run again with
it.
"""

import json
from pathlib import Path

import numpy as np
import pytest
from conftest import SampleRun

from stereo_seecolor.commands.run import run
from stereo_seecolor.config.file import load_config
from stereo_seecolor.dive.run_options import RunOptions
from stereo_seecolor.errors import InputError
from stereo_seecolor.extras.evaluation.truth import ResultFiles, evaluate_truth
from stereo_seecolor.extras.evaluation.water import measure_water, measure_white
from stereo_seecolor.records import Water

SAMPLES = Path(__file__).parents[2] / "data_samples" / "reef"
SIDES = (SAMPLES / "left", SAMPLES / "right", str(SAMPLES / "cam.yaml"))


@pytest.mark.slow
def test_sample_dive_measures_its_own_water(one_water: SampleRun, tmp_path: Path) -> None:
    """Attenuation within 10 % of truth from matched ranges, and colors no worse for it."""
    config = load_config(overrides=["color.lock=survey"])
    one_water.copy(tmp_path / "first")
    measured = measure_water(tmp_path / "first", SAMPLES / "trajectory.tum")
    path, found = measured.path, measured.water
    truth = json.loads((SAMPLES / "truth" / "water.json").read_bytes())["water"]
    z = 2.0
    np.testing.assert_allclose(
        -np.log(found.attenuation(np.array(z))) / z,
        np.array(truth["w"]) * np.exp(-np.array(truth["v"]) * z),
        rtol=0.1,
    )
    run(*SIDES, one_water.copy(tmp_path / "second"), config, RunOptions(water=path))
    first, second = (
        evaluate_truth(
            {
                each.stem: ResultFiles(
                    each, tmp_path / name / "corrected" / f"{each.stem}.png", None
                )
                for each in sorted((tmp_path / name / "range").iterdir())[::4]
            },
            SAMPLES / "truth",
        )
        for name in ("first", "second")
    )
    assert second.color.angle_deg < first.color.angle_deg + 0.3
    assert second.color.angle_after_gains_deg < first.color.angle_after_gains_deg + 0.1


@pytest.mark.slow
def test_a_run_with_a_water_for_each_frame_is_refused(waters_a_frame: Path) -> None:
    with pytest.raises(InputError, match=r"color\.lock=survey"):
        measure_water(waters_a_frame, SAMPLES / "trajectory.tum")


@pytest.mark.slow
def test_the_chart_of_the_sample_dive_gives_its_white(one_water: SampleRun, tmp_path: Path) -> None:
    """Seen in two frames, within the errors that the file states."""
    one_water.copy(tmp_path / "out")
    corners = {
        "reef_1790000001000": [[171.8, 163.4], [147.7, 45.3], [237.1, 29.8], [261.2, 147.9]],
        "reef_1790000002000": [[148.7, 309.5], [125.5, 166.1], [225.3, 148.0], [248.5, 291.4]],
    }
    targets = tmp_path / "targets.json"
    targets.write_text(json.dumps({name: [{"chart": points}] for name, points in corners.items()}))
    measured = measure_white(tmp_path / "out", targets)
    assert [chart.frame for chart in measured.charts] == list(corners)
    assert max(chart.residual_deg for chart in measured.charts) < 1
    found, true = (
        measured.water,
        Water.from_content(json.loads((SAMPLES / "truth" / "water.json").read_bytes())["water"]),
    )
    gains = [
        np.log(water.white * water.attenuation(np.array(found.typical_range_m)))
        for water in (found, true)
    ]
    off = (gains[0] - gains[0].mean()) - (gains[1] - gains[1].mean())
    assert (np.abs(off) < 2 * found.standard_errors["white"] / found.white).all(), (
        "of colors at the dive's typical range"
    )
    assert np.abs(off).max() < 0.15
    assert measured.trend and (np.abs(measured.trend.per_m) < 3 * measured.trend.error).all()
    # its camera is sRGB's
    assert (
        measured.matrix is None and "patches left out of its fit too little" in measured.no_matrix
    )
    assert max(chart.ciede2000 for chart in measured.charts) < 3
