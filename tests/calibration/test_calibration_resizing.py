"""Calibrations for resized images, and cameras whose images differ in size."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matching_scenes import Scene, render
from test_calibration_spellings import RIG
from test_turned_pairs import turned_dive

from calibration import CalibrationError, Camera, StereoRig
from calibration.formats import load_rig, load_rig_of_images
from calibration.resizing import resized_rig, wrong_size
from calibration.rig import quarter_turn
from calibration.transforms import rigid_transform
from stereo_seecolor.commands.convert_calib import convert_calib
from stereo_seecolor.config import RunConfig
from stereo_seecolor.pipeline import Pipeline
from stereo_seecolor.records import StereoFrame


@pytest.mark.parametrize("factor", [0.5, 2, 3])
def test_the_rays_of_resized_images_are_the_same(factor: float) -> None:
    width, height = (int(side * factor) for side in RIG.left.image_size)
    resized = resized_rig(RIG, (width, height))
    pixels = np.array([[10.0, 20.0], [300.0, 200.0]])
    for before, after in ((RIG.left, resized.left), (RIG.right, resized.right)):
        assert after.image_size == (width, height)
        np.testing.assert_allclose(
            after.rays((pixels + 0.5) * factor - 0.5), before.rays(pixels), atol=1e-7
        )
    np.testing.assert_array_equal(resized.T_right_left, RIG.T_right_left)


def test_binning_that_drops_the_odd_row_is_a_resizing() -> None:
    rig = replace(RIG, left=odd(RIG.left), right=odd(RIG.right))
    assert resized_rig(rig, (320, 240)).left.image_size == (320, 240)


def odd(camera: Camera) -> Camera:
    return replace(camera, image_size=(camera.image_size[0], camera.image_size[1] + 1))


def test_a_cut_out_is_no_resizing() -> None:
    with pytest.raises(
        CalibrationError, match=r"640x480 px cannot be resized to 640x400: .*\(1 and 0.8333\)"
    ):
        resized_rig(RIG, (640, 400))
    assert "a crop or another camera" in wrong_size("left", (640, 400), (640, 480))
    narrow = wrong_size("left", (1440, 1080), (1920, 1080))
    assert "sample aspect ratio" in narrow and "with square pixels, 1920x1080" in narrow


def test_a_right_image_alone_of_another_size_is_not_mended_by_the_calibration() -> None:
    assert "the left image fits it: give images of the calibrated sizes" in wrong_size(
        "right", (320, 240), (640, 480)
    )


@pytest.mark.slow
def test_a_right_camera_whose_images_are_turned(scene: Scene) -> None:
    rig, frame = turned_dive(scene, 0)
    pair = scene.pair.turned(1)
    turn = quarter_turn(-1)
    right = Camera(pair.P_left, np.zeros(0), pair.image_size)
    turned = StereoRig(
        rig.left, right, rigid_transform(turn @ rig.R, turn @ rig.T_right_left[:3, 3])
    )
    turned_frame = StereoFrame("turned", frame.left, np.ascontiguousarray(np.rot90(frame.right)))
    straight, found = (
        Pipeline(one, RunConfig()).process(images).range_map.range_m
        for one, images in ((rig, frame), (turned, turned_frame))
    )
    both = np.isfinite(straight) & np.isfinite(found)
    assert both.mean() > 0.6
    assert np.percentile(np.abs(found[both] / straight[both] - 1), 90) < 0.01


@pytest.fixture
def scene() -> Scene:
    return render((256, 192))


@pytest.mark.parametrize(("size", "made"), [((320, 240), "644x476"), ((1280, 960), "644x476")])
def test_a_file_without_a_size_that_was_made_at_another_is_refused(
    size: tuple[int, int], made: str, tmp_path: Path
) -> None:
    content = {f"K{n}": camera.K.tolist() for n, camera in ((1, RIG.left), (2, RIG.right))}
    content |= {
        f"D{n}": camera.distortion.tolist() for n, camera in ((1, RIG.left), (2, RIG.right))
    }
    file = tmp_path / "stereo.json"
    file.write_text(
        json.dumps(content | {"R": RIG.R.tolist(), "T": RIG.T_right_left[:3, 3].tolist()})
    )
    assert load_rig_of_images(file, (640, 480)).left.image_size == (640, 480)
    with pytest.raises(
        CalibrationError,
        match=f"in the middle of images of about {made} px, but these images have "
        f"{size[0]}x{size[1]}",
    ):
        load_rig_of_images(file, size)
    convert_calib(file, tmp_path / "resized.yaml", "native", "640x480", f"{size[0]}x{size[1]}")
    assert load_rig(tmp_path / "resized.yaml", size).left.K[0, 0] == pytest.approx(
        RIG.left.K[0, 0] * size[0] / 640
    )
