"""Telemetry of small vehicles as tracks: reports of a Water Linked DVL, and subtitles."""

import json
from pathlib import Path

import numpy as np
import pytest

from stereo_seecolor.errors import InputError
from stereo_seecolor.inputs.trajectories import read_trajectory

REPORT = {"std": 0.002, "status": 0, "format": "json_v3.1"}


def report(t: float, place: tuple[float, float, float], yaw: float) -> str:
    x, y, z = place
    where = {"ts": t, "x": x, "y": y, "z": z, "roll": 1.0, "pitch": -2.0, "yaw": yaw}
    return json.dumps({"type": "position_local", **where, **REPORT})


def subtitle(number: int, text: str) -> str:
    return f"{number}\n00:00:0{number},000 --> 00:00:0{number},900\n{text}\n\n"


def test_position_reports_of_a_dvl_are_a_track(tmp_path: Path) -> None:
    """Mixed with its reports of velocity; x is forward, y to starboard, z down."""
    velocity = json.dumps({"time": 106.3, "vx": 0.1, "type": "velocity", "format": "json_v3.1"})
    reports = [report(1.79e9 + i, (float(i), 2.0, 3.0), 90.0) for i in range(3)]
    path = tmp_path / "dvl.jsonl"
    path.write_text("\n".join([velocity, reports[0], velocity, *reports[1:]]))
    trajectory = read_trajectory(path)
    assert trajectory.timestamps_s.tolist() == [1.79e9, 1.79e9 + 1, 1.79e9 + 2]
    # east, north, up
    np.testing.assert_allclose(trajectory.T_world_camera[:, :3, 3], [[2, i, -3] for i in range(3)])


def test_velocities_alone_are_named(tmp_path: Path) -> None:
    path = tmp_path / "dvl.jsonl"
    row = json.dumps({"time": 106.3, "vx": 0.1, "type": "velocity", "format": "json_v3.1"})
    path.write_text(f"{row}\n{row}\n")
    with pytest.raises(InputError, match="velocities only"):
        read_trajectory(path)


def test_a_report_that_was_cut_short_is_named_with_its_line(tmp_path: Path) -> None:
    path = tmp_path / "dvl.jsonl"
    path.write_text(report(1.79e9, (0, 0, 1), 0) + "\n" + report(1.79e9, (0, 0, 1), 0)[:-9])
    with pytest.raises(InputError, match="line 2: is not a report"):
        read_trajectory(path)


def test_subtitles_with_place_depth_and_heading_are_a_track(tmp_path: Path) -> None:
    path = tmp_path / "dive.srt"
    path.write_text(
        "".join(
            subtitle(
                i,
                f"2026-05-01 10:00:0{i}.500\nLatitude: -14.68{i}, Longitude: 145.45, "
                f"Depth: {i}.5 m, Heading: 90 deg",
            )
            for i in range(1, 4)
        )
    )
    trajectory = read_trajectory(path)
    assert np.diff(trajectory.timestamps_s).tolist() == [1, 1]
    assert trajectory.T_world_camera[:, 2, 3].tolist() == [-1.5, -2.5, -3.5]
    north_m = trajectory.T_world_camera[:, 1, 3]
    assert np.diff(north_m) == pytest.approx(-111, abs=1)
    assert not trajectory.fixes


def test_subtitles_with_places_alone_are_fixes(tmp_path: Path) -> None:
    """As drones write them."""
    path = tmp_path / "flight.srt"
    path.write_text(
        "".join(
            subtitle(
                i,
                f"2026-05-01 10:00:0{i},500\n[latitude: -14.68{i}] [longitude: 145.45] "
                "[rel_alt: 1.300]",
            )
            for i in range(1, 4)
        )
    )
    assert read_trajectory(path).fixes


ASS = """[Script Info]
Title: Cockpit Subtitle Telemetry File

[Events]
Format: Layer, Start, End, Style, Name, MarginL, MarginR, MarginV, Effect, Text
"""


def dialogue(second: int, text: str) -> str:
    return (
        f"Dialogue: 0,0:00:0{second}.00,0:00:0{second + 1}.00,Default,,0,0,0,,"
        f"Time: 2026-05-01T10:00:0{second}\\N{text}\n"
    )


def test_cockpits_subtitles_with_a_position_are_a_track(tmp_path: Path) -> None:
    path = tmp_path / "cockpit.ass"
    text = "Depth: 2.00 m\\NHeading: 45.0 deg\\NLat: 63.4321\\NLon: 10.4"
    path.write_text(ASS + "".join(dialogue(i, text) for i in range(3)))
    trajectory = read_trajectory(path)
    assert trajectory.T_world_camera[:, 2, 3].tolist() == [-2, -2, -2]


@pytest.mark.parametrize(
    ("written", "said"),
    [
        (ASS + dialogue(1, "Depth: 2.00 m"), "show depth, time, and no position"),
        (subtitle(1, "Depth: 2 m") + subtitle(2, "Depth: 3 m"), "show no date and time"),
    ],
)
def test_subtitles_without_a_track_say_what_they_lack(
    tmp_path: Path, written: str, said: str
) -> None:
    path = tmp_path / "dive.txt"
    path.write_text(written)
    with pytest.raises(InputError, match=said):
        read_trajectory(path)
