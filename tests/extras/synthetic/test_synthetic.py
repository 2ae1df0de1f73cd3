"""The synthetic reef: its pictures agree with its truth, with each other, and with the water they
were taken through.
"""

from dataclasses import replace
from functools import cache
from pathlib import Path
from unittest.mock import create_autospec

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from calibration.formats import load_rig
from stereo_seecolor.errors import InputError, OutputError
from stereo_seecolor.extras.synthetic import casting, render
from stereo_seecolor.extras.synthetic.casting import cast
from stereo_seecolor.extras.synthetic.dive import parse_spec, synthesize
from stereo_seecolor.extras.synthetic.life import CHART
from stereo_seecolor.extras.synthetic.reef import CELL_M, Reef, blocks, build_reef
from stereo_seecolor.extras.synthetic.reef_light import sunlight
from stereo_seecolor.extras.synthetic.render import RenderedPair, Scene
from stereo_seecolor.extras.synthetic.survey import SurveySpec, track
from stereo_seecolor.extras.synthetic.waters import WATER_NAMES, WaterName, lit_water
from stereo_seecolor.inputs.name_times import timestamp_from_name
from stereo_seecolor.inputs.trajectories import read_trajectory
from stereo_seecolor.progress import Silence

SAMPLES = Path(__file__).parents[3] / "data_samples" / "reef"
SPEC = SurveySpec(pairs=6, image_size=(176, 144))


@pytest.fixture(scope="module")
def scene() -> Scene:
    return Scene.from_spec(SPEC)


@pytest.fixture(scope="module")
def pair(scene: Scene) -> RenderedPair:
    return scene.render(1)


def linear(image: NDArray[np.generic]) -> NDArray[np.float64]:
    share = image / np.iinfo(image.dtype).max
    return np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)


def smooth_pixels(pair: RenderedPair) -> NDArray[np.bool_]:
    """Pixels whose surroundings have nearly one range and one color, where interpolation cannot
    blur anything.
    """
    steep = cv2.morphologyEx(pair.range_map.range_m, cv2.MORPH_GRADIENT, np.ones((5, 5))) > 0.03
    busy = cv2.morphologyEx(pair.color, cv2.MORPH_GRADIENT, np.ones((5, 5))).max(axis=2) > 0.12
    return ~(steep | busy)


@pytest.mark.parametrize(("slope_x", "slope_y"), [(0.0, 0.0), (0.4, -0.2), (2.0, 1.0)])
def test_rays_meet_an_inclined_plane_where_geometry_says(slope_x: float, slope_y: float) -> None:
    y, x = np.meshgrid(np.arange(400) * CELL_M - 1.0, np.arange(400) * CELL_M - 1.0, indexing="ij")
    height_m = (slope_x * x + slope_y * y).astype(np.float32)
    empty = (np.zeros((4, 4, 4), np.float32),)
    reef = Reef((-1.0, -1.0), height_m, empty, empty, blocks(height_m), np.zeros((4, 2)))
    pose = np.eye(4)
    pose[:3, 3] = 0.1, -0.05, 2.0
    aim = np.stack(np.meshgrid(np.linspace(-0.15, 0.15, 31), np.linspace(-0.15, 0.15, 31)), axis=-1)
    rays = np.concatenate([aim, np.full((31, 31, 1), -1.0)], axis=-1)
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    met_m = cast(reef, pose, rays[:, :, None, :].astype(np.float32))[..., 0]
    expected_m = (2.0 - slope_x * 0.1 + slope_y * 0.05) / (
        slope_x * rays[..., 0] + slope_y * rays[..., 1] - rays[..., 2]
    )
    np.testing.assert_allclose(met_m, expected_m, atol=5e-4)


@pytest.mark.slow
def test_a_ray_that_looks_up_meets_nothing(scene: Scene) -> None:
    up = np.array([[[[0.0, 0.0, 1.0]]]], np.float32)
    assert np.isinf(cast(scene.reef, np.eye(4), up)).all()


@pytest.mark.slow
def test_right_image_shows_what_the_true_disparity_says(pair: RenderedPair) -> None:
    """Pulling the right image over by the true disparity gives the left one; half a pixel more or
    less gives a worse one.
    """
    rows, columns = np.indices(pair.range_map.disparity.shape, dtype=np.float32)
    seen = pair.visible & ~smooth_pixels(pair)

    def difference(shift_px: float) -> float:
        pulled = cv2.remap(
            pair.rectified.right,
            columns - pair.range_map.disparity - np.float32(shift_px),
            rows,
            cv2.INTER_LINEAR,
        )
        return float(np.abs(pulled[seen].astype(float) - pair.rectified.left[seen]).mean())

    assert difference(0.0) < 5.0
    assert difference(0.0) < 0.8 * min(difference(-0.5), difference(0.5))


@pytest.mark.slow
def test_images_follow_the_water_model(scene: Scene, pair: RenderedPair) -> None:
    """I = J light A(z) + B(z) in linear light, with light the sun at the depth of each point."""
    range_m = pair.range_map.range_m
    points_m = (
        scene.rectification.pair.points_from_range(range_m) @ pair.T_world_camera[:3, :3].T
        + pair.T_world_camera[:3, 3]
    )
    water = scene.water.water
    model = pair.color * sunlight(scene.water, points_m) * water.attenuation(
        range_m
    ) + water.backscatter(range_m)
    smooth = smooth_pixels(pair)
    ratio = np.median(linear(pair.rectified.left)[smooth] / model[smooth], axis=0)
    np.testing.assert_allclose(ratio, 1.0, atol=0.01)


@pytest.mark.slow
def test_truth_is_consistent(scene: Scene, pair: RenderedPair) -> None:
    geometry = scene.rectification.pair
    truth = pair.range_map
    np.testing.assert_allclose(
        geometry.depth_from_disparity(truth.disparity), truth.depth_m, rtol=1e-5
    )
    np.testing.assert_allclose(geometry.range_from_depth(truth.depth_m), truth.range_m, rtol=1e-6)
    column = np.arange(geometry.image_size[0]) - truth.disparity
    assert not pair.visible[column < 0].any()
    assert 0.8 < pair.visible.mean() < 1.0


@pytest.mark.slow
def test_same_specification_same_pictures_whatever_the_threads(
    pair: RenderedPair, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(casting, "cores", lambda: 3)
    again = Scene.from_spec(SPEC).render(1)
    assert np.array_equal(again.frame.left, pair.frame.left)
    assert np.array_equal(again.frame.right, pair.frame.right)
    assert np.array_equal(again.color, pair.color)
    assert np.array_equal(again.range_map.range_m, pair.range_map.range_m)


@pytest.mark.slow
def test_another_seed_is_another_reef(pair: RenderedPair) -> None:
    other = Scene.from_spec(replace(SPEC, seed=8)).render(1)
    assert np.abs(other.color - pair.color).mean() > 0.03


@pytest.mark.slow
def test_chart_has_its_reflectances(scene: Scene) -> None:
    """Each patch as seen in the truth has the hue of its reflectance; shading alone may darken
    it.
    """
    corners_m = scene.reef.chart_corners_m
    top_left, top_right, bottom_left = corners_m[0], corners_m[1], corners_m[3]
    across, down = (
        (top_right - top_left) / np.linalg.norm(top_right - top_left),
        (bottom_left - top_left),
    )
    down = down / np.linalg.norm(down)
    worst = 0.0
    for patch, reflectance in enumerate(CHART):
        row, column = divmod(patch, 6)
        x, y = (
            top_left
            + (0.015 + 0.085 * column + 0.0455) * across
            + (0.015 + 0.085 * row + 0.0455) * down
        )
        at = (
            round((y - scene.reef.origin_m[1]) / CELL_M),
            round((x - scene.reef.origin_m[0]) / CELL_M),
        )
        seen = scene.reef.color[0][at][:3]
        cosine = seen @ reflectance / np.linalg.norm(seen) / np.linalg.norm(reflectance)
        worst = max(worst, float(np.degrees(np.arccos(min(cosine, 1.0)))))
        assert 0.6 < np.linalg.norm(seen) / np.linalg.norm(reflectance) < 1.1
    assert worst < 0.5


@pytest.mark.slow
def test_fish_hide_the_reef(scene: Scene, pair: RenderedPair) -> None:
    first, bare = replace(scene, spec=replace(SPEC, fish=3)).render(1), pair
    assert first.moving.any()
    assert (first.range_map.range_m[first.moving] < bare.range_map.range_m[first.moving]).all()
    assert np.array_equal(
        first.range_map.range_m[~first.moving], bare.range_map.range_m[~first.moving]
    )


@pytest.mark.slow
def test_bare_patch_has_no_texture() -> None:
    reef = build_reef(SurveySpec(pairs=8, lines=1, textureless_patch=True))
    row, column = (
        round((place - origin) / CELL_M)
        for place, origin in zip((0.0, 0.85 * 3.5), reef.origin_m[::-1], strict=True)
    )
    patch = reef.color[0][row - 100 : row + 100, column - 100 : column + 100]
    grain = patch[..., :3] - cv2.blur(patch[..., :3], (21, 21))
    assert np.abs(grain[20:-20, 20:-20]).max() < 0.005
    assert patch[20:-20, 20:-20, 3].max() == 0.0


@pytest.mark.slow
@pytest.mark.parametrize(
    "lit", [replace(SPEC, caustic_contrast=0.5), replace(SPEC, lamp_intensity=2.0)]
)
def test_caustics_and_lamps_change_the_light_and_not_the_truth(
    scene: Scene, pair: RenderedPair, lit: SurveySpec
) -> None:
    other = replace(scene, spec=lit).render(1)
    assert np.array_equal(other.color, pair.color)
    assert np.abs(other.frame.left.astype(float) - pair.frame.left).mean() > 2.0


@pytest.mark.slow
def test_sixteen_bits_are_linear(scene: Scene, pair: RenderedPair) -> None:
    deep = replace(scene, spec=replace(SPEC, bits=16)).render(1)
    assert deep.frame.left.dtype == np.uint16
    np.testing.assert_allclose(deep.frame.left / 65535, linear(pair.frame.left), atol=0.004)


@pytest.mark.parametrize("name", WATER_NAMES)
def test_waters_take_red_first_and_light_away_with_depth(name: WaterName) -> None:
    shallow, deep = (lit_water(name, depth_m, depth_m - 2, 1.5) for depth_m in (5.0, 10.0))
    range_m = np.array([0.0, 1.0, 3.0, 1e4])
    transmission = shallow.water.attenuation(range_m)
    np.testing.assert_allclose(transmission[0], 1.0)
    assert transmission[2, 0] < transmission[2, 1]
    np.testing.assert_allclose(
        shallow.water.backscatter(range_m)[3], shallow.water.gamma_inf, rtol=1e-3
    )
    assert (
        deep.water.white[0] / deep.water.white[1] < shallow.water.white[0] / shallow.water.white[1]
    )
    assert (shallow.sun_attenuation > 0).all()
    white_patch = shallow.water.white * shallow.water.attenuation(np.array(1.5))
    assert white_patch.max() < 1.0
    if name != "turbid":  # whose veil takes room
        assert white_patch.max() > 0.9
    # in turbid water the veil is then three times the patch's own light
    for altitude_m in (1.5, 4.0):
        water = lit_water(name, 10.0, 10.0 - altitude_m, altitude_m).water
        seen = water.white * water.attenuation(np.array(altitude_m)) + water.backscatter(
            np.array(altitude_m)
        )
        assert 0.94 < seen.max() < 1.01


def test_track_flies_to_and_fro_and_climbs() -> None:
    spec = SurveySpec(pairs=160, lines=4, pair_spacing_m=0.4)
    flown = track(spec)
    x_m, y_m, z_m = flown.T_world_camera[:, :3, 3].T
    assert (np.diff(x_m[:40]) > 0).all()
    assert (np.diff(x_m[40:80]) < 0).all()
    assert np.ptp(y_m) == pytest.approx(3.0, abs=0.4)
    assert abs(z_m[:20].mean() - 1.7) < 0.1
    assert abs(z_m[-20:].mean() - 2.6) < 0.1
    down = flown.T_world_camera[:, 2, 2]
    assert (down < -0.9).all()
    assert len(set(flown.names)) == 160


SHORT = SurveySpec(pairs=2, lines=1, image_size=(128, 96))
BUILT = cache(build_reef)


@pytest.fixture
def built_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(render, "build_reef", BUILT)


@pytest.mark.slow
def test_dive_on_disk_reads_back(tmp_path: Path, built_once: None) -> None:
    spec = SHORT
    listener = create_autospec(Silence, instance=True)
    synthesize(spec, tmp_path / "dive", listener)
    listener.begin.assert_called_once_with("render", 2)
    assert listener.advance.call_count == 2
    scene = Scene.from_spec(spec)
    np.testing.assert_allclose(
        load_rig(tmp_path / "dive" / "cam.yaml").T_right_left, scene.rig.T_right_left
    )
    flown = read_trajectory(tmp_path / "dive" / "trajectory.tum")
    np.testing.assert_allclose(flown.T_world_camera, scene.trajectory.T_world_camera, atol=1e-7)
    names = sorted(path.stem for path in (tmp_path / "dive" / "left").glob("*.png"))
    np.testing.assert_allclose(
        [timestamp_from_name(name) or 0.0 for name in names], flown.timestamps_s, atol=1e-3
    )
    truth_m = cv2.imread(
        str(tmp_path / "dive" / "truth" / "range" / f"{names[1]}.tiff"), cv2.IMREAD_UNCHANGED
    )
    np.testing.assert_allclose(truth_m, scene.render(1).range_map.range_m, atol=2e-4)


@pytest.mark.slow
def test_sample_dive_is_what_its_command_makes() -> None:
    """Rounding differs between processors in the last bit of a float: that may move a pixel in ten
    thousand by one.
    """
    made = Scene.from_spec(
        parse_spec(pairs=12, lines=2, size="576x448", water="blue-ocean", seed=7)
    ).render(3)
    for folder, image in (
        ("left", made.frame.left),
        ("right", made.frame.right),
        ("truth/color", made.color_image),
    ):
        kept = cv2.imread(str(SAMPLES / folder / f"{made.frame.name}.png"))[..., ::-1]
        off = np.abs(kept.astype(int) - image)
        assert off.max() <= 1
        assert (off > 0).mean() < 1e-4


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"size": "640"}, "WIDTHxHEIGHT"),
        ({"size": "32x32"}, "at least 64x64"),
        ({"water": "red-sea"}, "blue-ocean"),
        ({"lines": 20}, "more lines"),
    ],
)
def test_specifications_that_cannot_be(given: dict[str, object], said: str) -> None:
    usual = {"pairs": 12, "lines": 2, "size": "640x512", "water": "blue-ocean", "seed": 7}
    with pytest.raises(InputError, match=said):
        parse_spec(**(usual | given))  # type: ignore[arg-type]


@pytest.mark.parametrize("own", ["dive", "dive/cam.yaml", "dive/left/reef_1790000000000.png"])
def test_synthesize_refuses_a_folder_with_other_files(tmp_path: Path, own: str) -> None:
    (tmp_path / own).parent.mkdir(parents=True, exist_ok=True)
    (tmp_path / own).write_text("mine")
    with pytest.raises(OutputError, match="nothing was changed"):
        synthesize(SurveySpec(pairs=1, lines=1, image_size=(64, 64)), tmp_path / "dive")
    assert (tmp_path / own).read_text() == "mine"


@pytest.mark.slow
def test_a_stopped_synthesis_continues(tmp_path: Path, built_once: None) -> None:
    spec, dive = SHORT, tmp_path / "dive"
    listener = create_autospec(Silence, instance=True)
    listener.advance.side_effect = KeyboardInterrupt
    with pytest.raises(KeyboardInterrupt):
        synthesize(spec, dive, listener)
    first, *others = sorted((dive / "left").iterdir())
    assert not others
    first.write_text("edited")
    synthesize(spec, dive)
    assert first.read_text() == "edited"
    assert len(list((dive / "truth" / "visible").iterdir())) == 2
    with pytest.raises(OutputError, match="already exists"):
        synthesize(replace(spec, seed=8), dive)
