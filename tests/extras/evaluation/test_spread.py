"""``evaluate --spread``: the same spots between frames, raw and corrected."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calibration import Rectification
from calibration.formats import load_rig
from stereo_seecolor.errors import InputError
from stereo_seecolor.extras.evaluation.spread import ComparedFrame, measure_spread
from stereo_seecolor.files.srgb import decode_srgb, encode_srgb
from stereo_seecolor.inputs.images import read_image, read_range_map
from stereo_seecolor.records import SurveyFrame

REEF = Path(__file__).parents[3] / "data_samples" / "reef"
RECTIFICATION = Rectification.from_rig(load_rig(REEF / "cam.yaml"))


def frame(raw_gain: float, shown_gain: float) -> ComparedFrame:
    """The first frame of the sample dive, brighter by factors of linear light."""
    name = min((REEF / "left").iterdir()).stem
    image = RECTIFICATION.apply_left(read_image(REEF / "left" / f"{name}.png"))
    range_m = read_range_map(REEF / "truth" / "range" / f"{name}.tiff")
    light = decode_srgb(image / 255.0)
    raw, shown = (
        np.round(255 * encode_srgb(np.clip(light * gain, 0, 1))).astype(np.uint8)
        for gain in (raw_gain, shown_gain)
    )
    std_m, known = (
        RECTIFICATION.pair.estimated_range_std_m(range_m),
        np.isfinite(range_m).astype(np.uint8) * np.uint8(255),
    )
    return ComparedFrame(raw, SurveyFrame(name, None, shown, range_m, std_m, known))


@pytest.mark.slow
def test_frames_of_other_brightness_are_offset_and_not_spread_within() -> None:
    frames = [
        replace(seen, others={"another tool": seen.raw})
        for seen in (frame(1.0, 1.0), frame(1.2, 1.0))
    ]
    report = measure_spread(frames, RECTIFICATION.pair, "srgb")
    assert report.pairs == 1
    assert report.others == {"another tool": report.raw}
    assert report.raw.frame_offsets == pytest.approx(np.log(1.2), abs=0.01)
    assert report.corrected.frame_offsets < 0.005
    assert report.raw.luminance < 0.03
    assert report.raw.angle_deg < 0.5
    assert report.corrected.spots > 5000


def test_a_single_frame_cannot_be_compared() -> None:
    with pytest.raises(InputError, match="no two frames up to four apart show the same spots"):
        measure_spread([frame(1.0, 1.0)], RECTIFICATION.pair, "srgb")


def lit(name: str, border: float, per_m: float) -> ComparedFrame:
    """A frame of the sample dive in its true colors; uncorrected, red is brighter at the border,
    and falls with range.
    """
    shown = read_image(REEF / "truth" / "color" / f"{name}.png")
    range_m = read_range_map(REEF / "truth" / "range" / f"{name}.tiff")
    light, (height, width) = decode_srgb(shown / 255.0), range_m.shape
    edge = np.ones((height, width), bool)
    edge[height // 10 : -height // 10, width // 10 : -width // 10] = False
    light[..., 0] *= np.where(edge, 1 + border, 1.0) * np.exp(-per_m * np.nan_to_num(range_m))
    raw = np.round(255 * encode_srgb(np.clip(light, 0, 1))).astype(np.uint8)
    std_m, known = (
        RECTIFICATION.pair.estimated_range_std_m(range_m),
        np.isfinite(range_m).astype(np.uint8) * np.uint8(255),
    )
    return ComparedFrame(raw, SurveyFrame(name, None, shown, range_m, std_m, known))


@pytest.mark.slow
def test_a_pink_border_and_lost_red_are_measured() -> None:
    names = sorted(path.stem for path in (REEF / "left").iterdir())[:6]
    report = measure_spread([lit(name, 0.2, 0.0) for name in names], RECTIFICATION.pair, "srgb")
    assert report.raw.border[1] - report.corrected.border[1] == pytest.approx(np.log(1.2), abs=0.02)
    assert abs(report.corrected.border[1]) < max(3 * report.corrected.border_error[1], 0.01)
    assert report.raw.border[2] == pytest.approx(report.corrected.border[2], abs=0.01)
    faded = measure_spread([lit(name, 0.0, 0.5) for name in names], RECTIFICATION.pair, "srgb")
    assert faded.corrected.far_red_to_blue == pytest.approx(report.corrected.far_red_to_blue)
    assert faded.raw.far_red_to_blue < 0.95 * faded.corrected.far_red_to_blue
