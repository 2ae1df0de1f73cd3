"""A pair whose cameras are mounted turned, or one below the other, through all of a run: what it
gives is the same, turned.
"""

import numpy as np
import pytest
from matching_scenes import Scene, render

from calibration import Camera, StereoRig
from calibration.rig import quarter_turn
from calibration.transforms import rigid_transform
from stereo_seecolor.config import RunConfig
from stereo_seecolor.pipeline import Pipeline
from stereo_seecolor.records import StereoFrame


@pytest.fixture(scope="module")
def scene() -> Scene:
    return render((256, 192))


def turned_dive(scene: Scene, turns: int) -> tuple[StereoRig, StereoFrame]:
    """Both images turned counterclockwise by quarters, and the rig that cameras mounted so are."""
    pair = scene.pair.turned(turns)
    camera = Camera(pair.P_left, np.zeros(0), pair.image_size)
    to_turned = quarter_turn(-turns)
    rig = StereoRig(
        camera, camera, rigid_transform(np.eye(3), to_turned @ [-scene.pair.baseline_m, 0.0, 0.0])
    )
    left, right = (
        np.ascontiguousarray(np.rot90(image, turns))
        for image in (scene.frame.left, scene.frame.right)
    )
    return rig, StereoFrame("turned", left, right)


@pytest.mark.slow
@pytest.mark.parametrize("turns", [1, 2, 3])
def test_ranges_and_colors_of_turned_cameras(scene: Scene, turns: int) -> None:
    config = RunConfig()
    straight = Pipeline(turned_dive(scene, 0)[0], config).process(scene.frame)
    rig, frame = turned_dive(scene, turns)
    pipeline = Pipeline(rig, config)
    found = pipeline.process(frame)
    assert found.range_map.range_m.shape == frame.left.shape[:2]
    wanted = np.rot90(straight.range_map.range_m, turns)
    both = np.isfinite(wanted) & np.isfinite(found.range_map.range_m)
    assert both.mean() > 0.6
    ratio = found.range_map.range_m[both] / wanted[both]
    assert np.percentile(np.abs(ratio - 1), 90) < 0.01
    truth_m = np.rot90(scene.pair.range_from_depth(scene.depth_m), turns)
    assert np.median(np.abs(found.range_map.range_m[both] / truth_m[both] - 1)) < 0.01
    difference = found.correction.image.astype(int) - np.rot90(
        straight.correction.image, turns
    ).astype(int)
    assert np.median(np.abs(difference[both])) <= 4
    T = pipeline.rectification.T_rectified_left
    np.testing.assert_allclose(T[:3, :3], np.eye(3), atol=1e-6)
