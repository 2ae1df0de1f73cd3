"""A map held to markers: of a rig whose stated scale is wrong, of a size that was mistyped, at
surveyed places, along bars.
"""

import json
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from mapping_scene import write_run
from numpy.typing import NDArray
from test_markers import EDGE_M, PLACES, RIG, bottom, cameras, frame

from calibration.transforms import rigid_transform, rotation_from_vector, transform_points
from stereo_seecolor.config import MappingConfig, MarkersConfig
from stereo_seecolor.config.file import load_config
from stereo_seecolor.errors import InputError
from stereo_seecolor.extras.reef.markers import Known, markers
from stereo_seecolor.mapping.frame_index import FrameIndex
from stereo_seecolor.mapping.marker_tables import Places
from stereo_seecolor.mapping.placing import PlacedSurvey, place_survey
from stereo_seecolor.mapping.survey import Survey
from stereo_seecolor.mapping.survey_map import check
from stereo_seecolor.mapping.track.fiducials import Marks
from stereo_seecolor.mapping.track.known_points import KnownLength, KnownPlace
from stereo_seecolor.mapping.track.marker_fit import first_fit
from stereo_seecolor.records import SurveyFrame, Trajectory

OFF = 1.012
"""The rig's ranges are so many times too long."""
SURVEYED = rigid_transform(rotation_from_vector(np.array([0.0, 0.0, 1.0])), [100.0, 200.0, -8.0])


@pytest.fixture(scope="module")
def frames() -> list[SurveyFrame]:
    texture = bottom()
    return [frame(i, each, texture).scaled(OFF) for i, each in enumerate(cameras())]


@pytest.fixture(scope="module")
def survey(frames: list[SurveyFrame]) -> Survey:
    return Survey(frames, RIG, FrameIndex.build(frames, RIG))


def held(survey: Survey, trajectory: Trajectory | None = None, **markers: object) -> PlacedSurvey:
    return place_survey(survey, MappingConfig(markers=MarkersConfig(**markers)), trajectory)  # type: ignore[arg-type]


def steps_m(T: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(np.linalg.norm(T[1:, :3, 3] - T[:1, :3, 3], axis=1))


@pytest.mark.slow
def test_one_tag_in_five_frames_sets_the_scale_to_a_thousandth(survey: Survey) -> None:
    placed = held(survey, edge_m=EDGE_M)
    assert placed.markers is not None and not placed.markers.refused
    assert placed.range_scale * OFF == pytest.approx(1, abs=1e-3)
    assert abs(placed.range_scale * OFF - 1) < 4 * placed.markers.scale_std < 4e-3
    T = placed.placement.T_world_camera
    assert steps_m(T) == pytest.approx(steps_m(cameras()), rel=2e-3, abs=1e-3)
    assert "3 found; ranges multiplied by 0.98" in str(placed.markers)
    scaled = survey.scaled(placed.range_scale)
    assert np.median(scaled.index.points_m[0][:, 2]) == pytest.approx(1.4, rel=2e-3)
    marks = Marks.found(survey, MarkersConfig(edge_m=EDGE_M))
    alone = replace(
        marks,
        observations={
            i: [each for each in own if each.number == 3] for i, own in marks.observations.items()
        },
    )
    assert first_fit(alone, T).scale * OFF == pytest.approx(1, abs=1e-3)


@pytest.mark.slow
def test_a_wrong_size_is_refused_and_named_and_what_disagrees_is_said(
    survey: Survey, tmp_path: Path
) -> None:
    placed = held(survey, edge_m=0.15)
    assert (
        placed.markers is not None
        and placed.markers.refused == ("edges",)
        and placed.range_scale == 1
    )
    assert any(
        "edges: the map has 1.3" in said and "not used" in said
        for said in placed.placement.warnings
    )
    (tmp_path / "bars.csv").write_text(f"first,second,length_m\n3,7,{1.008 * np.hypot(0.7, 0.3)}\n")
    both = held(survey, edge_m=EDGE_M, bars=tmp_path / "bars.csv")
    assert both.markers is not None and not both.markers.refused
    assert any(
        "bar 3-7: with all markers the map still has 0.99" in said
        for said in both.placement.warnings
    )


@pytest.mark.slow
def test_surveyed_places_give_the_world_and_the_scale(survey: Survey, tmp_path: Path) -> None:
    rows = (
        f"{n},{x},{y},{z},0.001"
        for n, p in PLACES.items()
        for x, y, z in [transform_points(SURVEYED, np.array([*p, 0.0]))]
    )
    (tmp_path / "gcp.csv").write_text("marker,x_m,y_m,z_m,std_m\n" + "\n".join(rows))
    placed = held(survey, points=tmp_path / "gcp.csv")
    assert (
        placed.markers is not None
        and placed.markers.control is not None
        and placed.markers.control.rms_m < 2e-3
    )
    expected = (SURVEYED @ cameras())[:, :3, 3]
    np.testing.assert_allclose(placed.placement.T_world_camera[:, :3, 3], expected, atol=0.01)
    T = cameras()
    given = Trajectory(tuple(f"f{i}" for i in range(5)), np.arange(5.0), T)
    elsewhere = held(survey, given, points=tmp_path / "gcp.csv")
    assert any("they contradict the given poses" in said for said in elsewhere.placement.warnings)
    assert np.abs(elsewhere.placement.T_world_camera[:, :3, 3] - T[:, :3, 3]).max() < 0.05


@pytest.mark.parametrize("table", ["bars", "points"])
def test_a_table_that_cannot_be_read_is_named_before_the_first_frame(
    tmp_path: Path, table: str
) -> None:
    config = load_config(None, [f"mapping.markers.{table}={tmp_path / 'absent.csv'}"])
    with pytest.raises(InputError, match=r"absent\.csv"):
        check(config.mapping, None)


@pytest.mark.slow
def test_a_map_that_cannot_be_held_says_so(survey: Survey, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("stereo_seecolor.mapping.track.pose_graph.available", lambda: False)
    config = MappingConfig(markers=MarkersConfig(edge_m=EDGE_M))
    assert any(
        "mapping.markers do not constrain the map" in said
        for said in place_survey(survey, config, None).placement.warnings
    )


def test_lengths_that_contradict_each_other_widen_the_error_and_unseen_ones_are_named(
    survey: Survey, tmp_path: Path
) -> None:
    bars = tmp_path / "bars.csv"
    apart_m = [math.dist(PLACES[3], PLACES[number]) for number in (7, 11)]
    bars.write_text(
        f"first,second,length_m\n3,7,{1.01 * apart_m[0]}\n7,3,{1.01 * apart_m[0]}\n"
        f"3,11,{apart_m[1]}\n3,99,1\n"
    )
    marks = Marks.found(survey, MarkersConfig(bars=bars))
    assert list(marks.bars) == [(3, 7), (3, 11), (3, 99)]
    fit = first_fit(marks, cameras())
    assert abs(fit.scale * OFF - 1) < 2 * fit.scale_std
    (line,) = fit.warnings
    assert line == "bar 3-99: too few of its markers were found in two frames: not used"
    alone = first_fit(replace(marks, bars={(3, 99): 1.0}), cameras())
    assert "none of a known size, distance or position" in str(alone) and alone.warnings == (line,)


def test_a_scale_is_weighed_against_the_calibration_and_named_where_it_is_far(
    survey: Survey,
) -> None:
    marks = Marks({}, EDGE_M, {}, Places({}, {}))
    nothing = first_fit(marks, np.tile(np.eye(4), (5, 1, 1)))
    assert (nothing.scale, nothing.scale_std) == (1.0, pytest.approx(0.005))
    assert "no marker constrains the map" in str(nothing)
    assert "ranges must be -1.80 % longer" in replace(nothing, scale=0.982).warnings[0]


@pytest.mark.parametrize(
    "known",
    [KnownLength((0, 1), (2,), 1.3, 0.1), KnownPlace((0, 2), np.array([0.1, 0.2, 0.3]), 0.1)],
)
def test_what_is_known_pulls_the_way_its_slope_says(known: KnownLength | KnownPlace) -> None:
    places = np.random.default_rng(0).normal(size=(len(known.points), 3))
    start, slope = known.off(places)
    for column in range(slope.shape[1]):
        moved = places.copy()
        moved.flat[column] += 1e-6
        np.testing.assert_allclose(
            (start - known.off(moved)[0]) / 1e-6, slope[:, column], atol=1e-4
        )


@pytest.mark.slow
def test_a_fused_map_is_held_to_its_markers_and_everything_reads_it_so(
    frames: list[SurveyFrame], tmp_path: Path, cli: Callable[..., tuple[int, str, str]]
) -> None:
    write_run(tmp_path / "out", frames, RIG)
    size = ("--set", f"mapping.markers.edge_m={EDGE_M}", "--set", "mapping.voxel_m=0.02")
    code, said, _ = cli("fuse", tmp_path / "out", *size)
    assert code == 0 and "markers: 3 found; ranges multiplied by 0.98" in said
    assert json.loads((tmp_path / "out/map/map.json").read_text())["range_scale"] == pytest.approx(
        1 / OFF, rel=1e-3
    )
    check = markers(tmp_path / "out", Known(EDGE_M)).size
    assert check is not None and check.ratio == pytest.approx(1, abs=1e-3)
    code, said, _ = cli("fuse", tmp_path / "out", "--set", "mapping.markers.edge_m=0.1", "--json")
    assert code == 3 and json.loads(said)["map"]["markers"]["refused"] == ["edges"]
