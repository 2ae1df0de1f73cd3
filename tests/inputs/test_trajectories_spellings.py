"""One track in every table, spelling, time and notation that people bring: it is read as it is, or
refused in a line that says what is wrong.
"""

import json
from collections.abc import Callable, Sequence
from datetime import UTC, datetime
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from test_trajectories import EAST_UP, NORTH_UP, write

from stereo_seecolor.errors import InputError
from stereo_seecolor.inputs.trajectories import read_trajectory, trajectory_format
from stereo_seecolor.inputs.trajectories.times import column_seconds
from stereo_seecolor.records import Trajectory

NOON = 1792152000  # 2026-10-16 12:00:00 UTC
TIMES = [NOON, NOON + 1]
SIX_PARTS = ("year", "month", "day", "hours", "minutes", "seconds")
STD = ("time", "lat", "lon", "depth", "heading")
ROWS: list[list[Any]] = [[NOON, -14.685, -61.05, 5, 0], [NOON + 1, -14.685, -61.0499, 6, 90]]


def table(names: Sequence[str] = STD, rows: Sequence[Sequence[Any]] = ROWS, by: str = ",") -> str:
    return "\n".join(by.join(map(str, row)) for row in (names, *rows)) + "\n"


def with_times(texts: Sequence[str]) -> str:
    return table(rows=[[text, *row[1:]] for text, row in zip(texts, ROWS, strict=True)])


def is_the_track(found: Trajectory) -> bool:
    T = found.T_world_camera[: len(ROWS)]
    east_m = (0, 0.0001 * 111_320 * np.cos(np.radians(14.685)))
    right = np.column_stack([east_m, (0, 0), (-5, -6)])
    return bool(
        np.allclose(T[:, :3, :3], [NORTH_UP, EAST_UP], atol=1e-9)
        and np.allclose(T[:, :3, 3] - [T[0, 0, 3], T[0, 1, 3], 0], right, atol=0.05)
        and found.origin is not None
        and abs(found.origin.latitude_deg + 14.685) < 0.001
        and np.allclose(found.timestamps_s[: len(ROWS)], TIMES, atol=0.01)
        and not any(found.names)
    )


NAMES = {
    "camel case": "timeStamp,latitudeDeg,longitudeDeg,depthM,headingDeg",
    "units": "Time (UTC),Latitude [°],Lon_deg,depth_m,heading_true",
    "German": "Zeitstempel,Breitengrad,Längengrad,Tauchtiefe,Steuerkurs",
    "French": "Horodatage,Latitude,Longitude,Profondeur,Cap",
    "Spanish": "FechaHora,Latitud,Longitud,Profundidad,Rumbo",
    "Italian": "Ora,Latitudine,Longitudine,Profondità,Rotta",
    "Portuguese": "Hora,Latitude,Longitude,Profundidade,Rumo",
    "Dutch": "Tijd,Breedtegraad,Lengtegraad,Diepte,Koers",
    "an owner": "UTC Time,ROV_Lat,ROV_Lon,Vehicle Depth,Vehicle Heading",
    "a beacon": "Time,Beacon Latitude,Beacon Longitude,Beacon Depth,Heading",
    "paths": "/nav/time,/nav/lat,/nav/lon,/nav/depth,/nav/heading",
    "an Iver": "Epoch Secs,Latitude,Longitude,DFS Depth (m),C True Heading",
    "decimal": "utc_timestamp,decimalLatitude,longitude_dd,depth_below_surface,compassHeading",
}


@pytest.mark.parametrize("language", NAMES)
def test_names_of_columns(language: str, tmp_path: Path) -> None:
    assert is_the_track(
        read_trajectory(write(tmp_path, table(NAMES[language].split(",")), "nav.csv"))
    )


FORMS: dict[str, str | bytes] = {
    "bars": table(by="|"),
    "spaces": table(by="   "),
    "UTF-16": table().encode("utf-16"),
    "lines above": f"Vehicle: BlueROV2\nDive: 3\n\n{table()}",
    "comments above": f"# export of 2026\n# dive 3\n{table()}",
    "a line of units": table(rows=[["[UTC]", "deg", "deg", "[m]", "[deg]"], *ROWS]),
    "words below": f"{table()}END OF FILE\n",
    "rows of commas": f"{table()},,,,\n,,,,\n",
    "a hemisphere beside": table(("time", "lat", "N/S", "lon", "E/W", "depth", "heading"), [
        [t, -lat, "S", -lon, "W", *rest] for t, lat, lon, *rest in ROWS]),
    "ddmm.mmmm": table(("time", "lat", "N/S", "lon", "E/W", "depth", "heading"), [
        [t, "1441.1000", "S", f"61{-60 * (lon + 61):07.4f}", "W", *rest]
        for t, lat, lon, *rest in ROWS]),
    "MAVLink's degrees": table(rows=[
        [t, round(lat * 1e7), round(lon * 1e7), *rest] for t, lat, lon, *rest in ROWS]),
    "feet": table((*STD[:3], "Depth (ft)", "heading"), [
        [*row[:3], row[3] / 0.3048, row[4]] for row in ROWS]),
    "millimeters and hundredths": table((*STD[:3], "depth_mm", "hdg_cdeg"), [
        [*row[:3], row[3] * 1000, row[4] * 100] for row in ROWS]),
    "what is of a ship": table((*STD, "ship_lat", "ship_lon"), [[*row, 50, 10] for row in ROWS]),
    "the vehicle's before the receiver's": table(("time", "gps.lat", "gps.lon", *(
        f"vehicle.{name}" for name in STD[1:])), [[row[0], 50, 10, *row[1:]] for row in ROWS]),
    "hemispheres in words": table(("time", "lat", "latRef", "lon", "lonRef", "depth", "heading"), [
        [t, -lat, "South", -lon, "West", *rest] for t, lat, lon, *rest in ROWS]),
    "hemispheres before": table(("time", "lat_ref", "lat", "lon_ref", "lon", "depth", "heading"), [
        [t, "S", -lat, "W", -lon, *rest] for t, lat, lon, *rest in ROWS]),
    "hemispheres after both": table(("time", "lat", "lon", "N/S", "E/W", "depth", "heading"), [
        [t, -lat, -lon, "S", "W", *rest] for t, lat, lon, *rest in ROWS]),
    "a flag that is no hemisphere": table((*STD, "mode"), [[*row, "N"] for row in ROWS]),
    "the vehicle's beside those of a ship": table((*STD[:3], "heading", *(
        f"ROV {name}" for name in STD[1:])), [[row[0], 50, 10, 45, *row[1:]] for row in ROWS]),
    "depths below the water": table(("time", "water depth", *STD[1:]), [
        [row[0], 50, *row[1:]] for row in ROWS]),
    "a temperature": table(("T", "S", *STD), [[21, 35, *row] for row in ROWS]),
    "the name of a vehicle": table(("RovName", *STD), [["v1", *row] for row in ROWS]),
    "twelve columns": table((*STD, *"abcdefg"), [[*row, *[1] * 7] for row in ROWS]),
    "ten words": table((*STD, *"abcd", "e"), [[*row, *[1] * 4, "x"] for row in ROWS], by=" "),
    "fourteen columns between semicolons": table((*STD, *"abcdefghi"), [
        [*row, *[1] * 9] for row in ROWS], by=";").replace(".", ","),
    "a time since a start": table((*STD, "UTC"), [
        [i, *row[1:], row[0]] for i, row in enumerate(ROWS)]),
    "hours and minutes": table(("DATE", "TIME", *STD[1:]), [
        ["20261016", "1200", *ROWS[0][1:]], ["20261016", "120001", *ROWS[1][1:]]]),
    "a date in three columns": table(("year", "month", "day", *STD), [
        [2026, 10, 16, f"12:0:{i}.0", *row[1:]] for i, row in enumerate(ROWS)]),
    "six columns of a time": table(("date", *SIX_PARTS,
                                    *STD[1:]), [
        ["x", 2026, 10, 16, 12, 0, f"{i}.0", *row[1:]] for i, row in enumerate(ROWS)]),
    "a date and a time": table(("date", "time", "latitude", "longitude", "depth", "heading"), [
        [*datetime.fromtimestamp(row[0], UTC).isoformat().split("T"), *row[1:]] for row in ROWS]),
    "a date with its time": table(("date", *STD[1:]), [
        [datetime.fromtimestamp(row[0], UTC).isoformat(), *row[1:]] for row in ROWS]),
    "a noisy height at the surface": table(rows=[
        *([row[0], *row[1:3], -row[3], row[4]] for row in ROWS), ["", 0, 0, 0.1, 0]]),
    "JSON of records of a device": json.dumps({"1": {"streams": {"nav": {"samples": [
        dict(zip(STD, row, strict=True)) for row in ROWS]}}}, "rate": 1}),
    "JSON of records": json.dumps([dict(zip(STD, row, strict=True)) for row in ROWS]),
    "a record a line": "\n".join(json.dumps(dict(zip(STD, row, strict=True))) for row in ROWS),
    "JSON of columns": json.dumps(dict(zip(STD, map(list, zip(*ROWS, strict=True)), strict=True))),
    "points of GeoJSON": json.dumps({"type": "FeatureCollection", "features": [
        {"type": "Feature", "geometry": {"type": "Point", "coordinates": [lon, lat]},
         "properties": {"time": t, "depth": depth, "heading": heading}}
        for t, lat, lon, depth, heading in ROWS]}),
}  # fmt: skip


@pytest.mark.parametrize("form", FORMS)
def test_forms_of_tables(form: str, tmp_path: Path) -> None:
    content = FORMS[form]
    (tmp_path / "nav.csv").write_bytes(content if isinstance(content, bytes) else content.encode())
    assert is_the_track(read_trajectory(tmp_path / "nav.csv"))


def test_a_map_of_columns_holds_below_other_lines(tmp_path: Path) -> None:
    path = write(tmp_path, f"Dive 3\n\n{table(('A', 'B', 'C', 'D', 'E'))}", "nav.csv")
    assert is_the_track(read_trajectory(Path(f"{path}:time=A,lat=B,lon=C,depth=D,heading=E")))


def test_positions_of_images_by_exiftool(tmp_path: Path) -> None:
    names = "SourceFile,GPSLatitude,GPSLongitude,RelativeAltitude,DateTimeOriginal"
    rows = ['left/a.jpg,"14 deg 41\' 6.00"" S","61 deg 3\' 0.00"" W",2,2026:10:16 12:00:00']
    rows += [rows[0].replace("a.jpg", "b.jpg").replace("00:00", "00:01")]
    path = write(tmp_path, "\n".join([names, *rows]), "exif.csv")
    spec = "name=SourceFile,lat=GPSLatitude,lon=GPSLongitude,time=DateTimeOriginal"
    with pytest.raises(InputError, match=f"or use its positions alone: exif.csv:{spec}"):
        read_trajectory(path)
    found = read_trajectory(Path(f"{path}:{spec}"))
    assert found.fixes and found.names == ("left/a.jpg", "left/b.jpg")
    assert found.timestamps_s.tolist() == TIMES and found.origin is not None
    assert found.origin.latitude_deg == pytest.approx(-14.685)
    assert found.origin.longitude_deg == pytest.approx(-61.05)


@pytest.mark.parametrize(
    "names",
    ["year month day hour minute second", "Year Month Day Hour Minute Second", "secs nsecs"],
)
def test_times_in_several_columns(names: str, tmp_path: Path) -> None:
    clocks = [
        (t, 0) if "nsecs" in names else (*datetime.fromtimestamp(t, UTC).timetuple()[:6],)
        for t in TIMES
    ]
    rows = [[*clock, *row[1:]] for clock, row in zip(clocks, ROWS, strict=True)]
    text = table((*names.split(), *STD[1:]), rows)
    assert is_the_track(read_trajectory(write(tmp_path, text, "nav.csv")))


FORMATS = {
    "compact": "%Y%m%d%H%M%S", "underscore": "%Y%m%d_%H%M%S",
    "name of a month": "%d-%b-%Y %H:%M:%S", "its year in two digits": "%d-%b-%y %H:%M:%S",
    "month first": "%B %d %Y %H:%M:%S", "EXIF": "%Y:%m:%d %H:%M:%S",
    "day of the year": "%Y-%j %H:%M:%S", "comma before milliseconds": "%Y-%m-%d %H:%M:%S,000",
}  # fmt: skip


@pytest.mark.parametrize("name", FORMATS)
def test_notations_of_time(name: str, tmp_path: Path) -> None:
    texts = [datetime.fromtimestamp(t, UTC).strftime(FORMATS[name]) for t in TIMES]
    assert is_the_track(read_trajectory(write(tmp_path, with_times(texts), "nav.csv")))


@pytest.mark.parametrize("day", [25569, 719529])
def test_days_of_spreadsheets_and_matlab(day: float, tmp_path: Path) -> None:
    texts = [repr(t / 86400 + day) for t in TIMES]
    assert is_the_track(read_trajectory(write(tmp_path, with_times(texts), "nav.csv")))


def test_seconds_of_a_dive_are_not_days() -> None:
    assert column_seconds(["40000.0", "40000.5"]) == [40000.0, 40000.5]


def test_a_row_of_single_digits_is_no_line_of_units(tmp_path: Path) -> None:
    rows = [[i, 1, 2, 3, 0] for i in range(3)]
    found = read_trajectory(write(tmp_path, table(rows=rows), "nav.csv"))
    assert found.timestamps_s.tolist() == [0, 1, 2]


def test_cells_beyond_the_header_are_refused(tmp_path: Path) -> None:
    path = write(tmp_path, table(rows=[[row[0], "x", *row[1:]] for row in ROWS]), "nav.csv")
    with pytest.raises(InputError, match="line 2: has 6 columns, the header has 5"):
        read_trajectory(path)


# Poses as rows of numbers.

ROTATIONS = Rotation.from_euler("ZYX", [[0, 0, 180], [-60, 10, 170]], degrees=True)
PLACES = np.array([[1.0, 2, -3], [1.5, 2, -3]])
MATRICES = np.tile(np.eye(4), (2, 1, 1))
MATRICES[:, :3, :3], MATRICES[:, :3, 3] = ROTATIONS.as_matrix(), PLACES
QUATERNIONS = ROTATIONS.as_quat()


def text_of(rows: Sequence[Sequence[Any]], by: str = " ") -> str:
    return "\n".join(by.join(map(str, row)) for row in rows) + "\n"


def saved(save: Callable[..., None], *arrays: Any, **named: Any) -> bytes:
    stream = BytesIO()
    save(stream, *arrays, **named)
    return stream.getvalue()


FIRST = [[t] for t in TIMES]
FILES = [["a.png"], ["b.png"]]
QUANTITIES = ("x", "y", "z", "qx", "qy", "qz", "qw")
TUM = np.column_stack([TIMES, PLACES, QUATERNIONS]).tolist()
W_FIRST = np.column_stack([TIMES, PLACES, QUATERNIONS[:, [3, 0, 1, 2]]]).tolist()
TWELVE, SIXTEEN = MATRICES[:, :3].reshape(2, 12).tolist(), MATRICES.reshape(2, 16).tolist()
POSES: dict[str, str | bytes] = {
    "a comment that says w first": "#timestamp [ns],p_x [m],p_y [m],p_z [m],q_w [],q_x [],q_y [],"
                                   "q_z []\n" + text_of(W_FIRST, ","),
    "names between spaces": "timestamp tx ty tz qw qx qy qz\n" + text_of(W_FIRST),
    "semicolons": text_of(TUM, ";"),
    "decimal commas": text_of(TUM, ";").replace(".", ","),
    "a name before TUM's": text_of([a + b[1:] for a, b in zip(FILES, TUM, strict=True)]),
    "KITTI with commas": text_of(TWELVE, ","),
    "matrices of 4x4": text_of(SIXTEEN),
    "matrices on four lines": "\n".join(text_of(matrix) for matrix in MATRICES.tolist()),
    "a time before KITTI's": text_of([a + b for a, b in zip(FIRST, TWELVE, strict=True)]),
    "an index before KITTI's": text_of([[i, *row] for i, row in enumerate(TWELVE)]),
    "a name before KITTI's": text_of([a + b for a, b in zip(FILES, TWELVE, strict=True)]),
    "a .npy of matrices": saved(np.save, MATRICES),
    "a .npy of TUM's": saved(np.save, np.array(TUM)),
    "a .npz with times": saved(np.savez, poses=MATRICES, timestamps=TIMES),
    "JSON by name": json.dumps({name: m for (name,), m in zip(FILES, MATRICES.tolist(),
                                                              strict=True)}),
    "JSON of transforms into the camera": json.dumps([
        {"file": name, "world_to_cam": np.linalg.inv(m).tolist()}
        for (name,), m in zip(FILES, MATRICES, strict=True)]),
    "JSON of messages": json.dumps([
        {"stamp": t, "pose": {"position": dict(zip("xyz", p, strict=True)),
                              "orientation": dict(zip("xyzw", q, strict=True))}}
        for t, p, q in zip(TIMES, PLACES.tolist(), QUATERNIONS.tolist(), strict=True)]),
    "names under a header": "image_name,x,y,z,qx,qy,qz,qw\n"
                            + text_of([a + b[1:] for a, b in zip(FILES, TUM, strict=True)], ","),
    "a name beside the time": "file,stamp,x,y,z,qx,qy,qz,qw\n"
                              + text_of([a + b for a, b in zip(FILES, TUM, strict=True)], ","),
    "the time of one body": "stamp,name,x,y,z,qx,qy,qz,qw\n"
                            + text_of([[r[0], "rov", *r[1:]] for r in TUM], ","),
    "millimeters": "x [mm],y [mm],z [mm],qx,qy,qz,qw,t\n"
                   + text_of([[*(1000 * v for v in r[1:4]), *r[4:], r[0]] for r in TUM], ","),
    "PlotJuggler": text_of([["__time", *(f"/odom/pose/position/{a}" for a in "xyz"),
                             *(f"/odom/pose/orientation/{a}" for a in "xyzw")], *TUM], ","),
}  # fmt: skip


@pytest.mark.parametrize("form", POSES)
def test_rows_of_poses(form: str, tmp_path: Path) -> None:
    content = POSES[form]
    path = tmp_path / ("poses.npz" if ".npz" in form else "poses.txt")
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    found = read_trajectory(path)
    np.testing.assert_allclose(found.T_world_camera, MATRICES, atol=1e-9)
    if "name" in form and "names between" not in form:
        assert found.names == ("a.png", "b.png")
    if "time" in form or "stamp" in form:
        np.testing.assert_allclose(found.timestamps_s, TIMES)
    assert trajectory_format(path) is not None


@pytest.mark.parametrize(
    ("name", "others"),
    [("time_ms", ""), ("timestamp [ns]", ""), ("%time", "field.header.stamp")],
)
def test_units_of_the_times_of_poses(name: str, others: str, tmp_path: Path) -> None:
    """Since the start of a simulation, whose size tells no unit."""
    axes = [f"field.pose.{axis}" if others else axis for axis in QUANTITIES]
    a_second = 1000 if "ms" in name else 10**9
    rows = [[int((800 + i) * a_second), 7, *row[1:]] for i, row in enumerate(TUM)]
    text = text_of([[name, others or "seq", *axes], *rows], ",")
    found = read_trajectory(write(tmp_path, text, "poses.csv"))
    assert found.timestamps_s.tolist() == [800, 801]


@pytest.mark.parametrize("count", [8, 12, 13, 16])
def test_numbers_that_hold_no_rotation_are_no_poses(count: int, tmp_path: Path) -> None:
    row = [NOON, 14.6, 145.2, 5.5, 90.0, 1.5, -2.0, 1.4, 21.0, 35.1, 5.0, 1.0, 0, 0, 0, 1]
    if count == 16:
        row[:3] = 1.0, 0.5, 0.2
    path = write(tmp_path, text_of([row[:count]] * 3), "nav.txt")
    with pytest.raises(InputError, match=r"line 1: .* hold no rotation: .*names in a line above"):
        read_trajectory(path)


def test_the_first_number_of_tum_is_a_time(tmp_path: Path) -> None:
    rows = [[i, *row[1:]] for i, row in enumerate(TUM)]
    assert read_trajectory(write(tmp_path, text_of(rows), "a.tum")).timestamps_s.tolist() == [0, 1]


def test_an_archive_without_poses_is_named(tmp_path: Path) -> None:
    (tmp_path / "rig.npz").write_bytes(saved(np.savez, K=np.eye(3)))
    with pytest.raises(InputError, match="holds 0 arrays of poses among K"):
        read_trajectory(tmp_path / "rig.npz")
