"""Images that programs hand over as arrays, and paths that they give as text."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

import stereo_seecolor
from calibration.formats import load_rig
from calibration.rig import COLOR_TAKEN
from stereo_seecolor import Pipeline, StereoFrame, Water, load_config
from stereo_seecolor.errors import InputError, MatchingError
from stereo_seecolor.extras.synthetic.demo import DemoResult
from stereo_seecolor.inputs.images import as_image, read_image
from stereo_seecolor.pipeline import Stream

RGB = np.random.default_rng(0).integers(0, 256, (4, 5, 3), np.uint8)
GRAY = RGB[..., 0]


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        (RGB, RGB),
        (RGB.tolist(), RGB),
        (RGB.astype(np.int64), RGB),
        (RGB.astype(np.uint16) * 257, RGB.astype(np.uint16) * 257),
        (RGB.astype(np.int32) * 257, RGB.astype(np.uint16) * 257),
        (RGB / 255, RGB.astype(np.uint16) * 257),
        ((RGB / 255).astype(np.float32), RGB.astype(np.uint16) * 257),
        (GRAY, np.dstack([GRAY] * 3)),
        (GRAY[..., None], np.dstack([GRAY] * 3)),
        (np.dstack([RGB, GRAY]), RGB),
    ],
)
def test_arrays_of_many_kinds_are_images(given: Any, expected: np.ndarray) -> None:
    found = as_image(given, "x")
    assert found.dtype == expected.dtype
    assert np.array_equal(found, expected)


def test_floating_point_of_16_bits_is_a_fraction_of_full_scale() -> None:
    found = as_image((RGB / 255).astype(np.float16), "x")
    assert np.abs(found.astype(int) - RGB.astype(np.uint16) * 257).max() < 65535 / 2048


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (RGB.astype(float), "holds float64 from"),
        (RGB.astype(int) - 300, "holds int64 from -"),
        (np.full((4, 5, 3), np.nan), "NaN or infinity"),
        (np.where(RGB.max() == RGB, np.inf, RGB / 255), "NaN or infinity"),
        (RGB > 9, "holds bool"),
        (np.zeros((4, 5, 2)), "shape"),
        (np.zeros((0, 5, 3)), "shape"),
        ("picture", "shape"),
    ],
)
def test_what_is_no_image_is_named_in_a_line(given: Any, said: str) -> None:
    with pytest.raises(InputError, match=said) as caught:
        as_image(given, "f1: the left image")
    assert str(caught.value).startswith("f1: the left image: ") and "\n" not in str(caught.value)


def test_one_image_for_both_sides_is_refused(make_dive) -> None:
    """Rectified, the two differ, and a tenth of the pixels would match, at wrong ranges."""
    dive = make_dive(1)
    image = read_image(dive.root / "L/0000.png")
    with pytest.raises(MatchingError, match="a: left and right are the same image"):
        Pipeline(dive.root / "cam.yaml").process(StereoFrame("a", image, image.copy()))


def test_the_first_pair_shows_how_to_read_a_calibration(make_dive) -> None:
    """Of a file with two readings the wrong one failed all pairs, and a camera was blamed."""
    dive = make_dive(1)
    true = load_rig(dive.root / "cam.yaml")
    turned = true.T_right_left.copy()
    turned[:3, :3] = cv2.Rodrigues(np.array([0.05, 0.0, 0.0]))[0]
    pipeline = Pipeline(replace(true, T_right_left=turned).with_alternatives([true]))
    sides = (read_image(dive.root / side / "0000.png") for side in "LR")
    found = pipeline.process(StereoFrame("a", *sides)).range_map.range_m
    np.testing.assert_allclose(np.nanmedian(found / dive.range_m), 1, atol=0.01)
    np.testing.assert_array_equal(pipeline.rig.T_right_left, true.T_right_left)
    wider = true.T_right_left @ np.array([[1, 0, 0, -0.01], *np.eye(4)[1:]])
    color = replace(true, reading=COLOR_TAKEN, T_right_left=wider)
    pipeline = Pipeline(color.with_alternatives([true]))
    gray = (read_image(dive.root / side / "0000.png")[..., 1] for side in "LR")
    pipeline.process(StereoFrame("a", *gray))
    assert pipeline.rig.baseline_m == true.baseline_m


def test_another_exposure_within_a_stream_is_said(make_dive) -> None:
    dive = make_dive(3)
    stream, warned = Stream(Pipeline(dive.root / "cam.yaml")), []
    for number, factor in enumerate((1.0, 1.0, 0.5)):
        sides = (read_image(dive.root / side / f"{number:04d}.png") for side in "LR")
        pair = [(factor * image).astype(np.uint8) for image in sides]
        found = stream.process(StereoFrame("a", *pair)).warnings
        warned.append(
            any("times as bright, at equal ranges, as the frames" in one for one in found)
        )
    assert warned == [False, False, True]


@pytest.mark.slow
def test_paths_may_be_text(finished_demo: DemoResult) -> None:
    out = finished_demo.out
    frame = stereo_seecolor.open_run(str(out)).frames[0]
    corrected = frame.products["corrected"]
    assert np.array_equal(read_image(str(corrected)), read_image(corrected))
    assert load_config(str(out / "run.json")) == load_config(out / "run.json")


def test_a_water_takes_lists() -> None:
    water = Water(*([0.1, 0.2, 0.3] for _ in range(8)))
    assert water.beta.dtype == np.float64 and water.attenuation(np.array(1.0)).shape == (3,)


def test_a_package_of_the_same_name_as_ours_is_named(tmp_path: Path) -> None:
    import os
    import subprocess
    import sys

    (tmp_path / "calibration.py").write_text("")
    environment = os.environ | {"PYTHONPATH": str(tmp_path)}
    command = [sys.executable, "-c", "import stereo_seecolor"]
    shown = subprocess.run(command, env=environment, capture_output=True, text=True, cwd=tmp_path)
    assert shown.returncode
    last = shown.stderr.splitlines()[-1]
    assert f"another package called calibration ({tmp_path / 'calibration.py'})" in last


@pytest.mark.parametrize(("bits", "error"), [(10, "is black"), (12, "")])
def test_arrays_of_fewer_bits_are_named_until_one_has_more(
    make_dive, bits: int, error: str
) -> None:
    dive = make_dive(1, dtype=np.uint16)
    deep = StereoFrame("a", *(read_image(dive.root / side / "0000.png") for side in "LR"))
    few = replace(deep, left=deep.left >> (16 - bits), right=deep.right >> (16 - bits))
    pipeline = Pipeline(dive.root / "cam.yaml")
    said = f"if the camera has {bits} bits, multiply them by {1 << 16 - bits} "
    if error:
        with pytest.raises(MatchingError, match=f"{error}.*{said}"):
            pipeline.process(few)
    else:
        assert said in " ".join(pipeline.process(few).warnings)
        assert "if the camera has" not in " ".join(pipeline.process(deep).warnings)
        assert "if the camera has" not in " ".join(pipeline.process(few).warnings)
