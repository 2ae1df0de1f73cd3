"""Tracks as the field writes them: cells without a value, dates of two orders, degrees and minutes,
receivers' logs.
"""

import json
import os
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest
from test_trajectories import EAST_UP, NORTH_UP, write

from stereo_seecolor.commands.inspect_poses import find_poses
from stereo_seecolor.commands.inspect_problems import unknown_files
from stereo_seecolor.errors import InputError
from stereo_seecolor.inputs.trajectories import read_trajectory, trajectory_format
from stereo_seecolor.inputs.trajectories.times import AmbiguousDateError, TimeError, column_seconds
from stereo_seecolor.records import Trajectory

HEADER = "timestamp,latitude,longitude,depth,heading"
NOON = 1792152000.0  # 2026-10-16 12:00:00 UTC


def known(trajectory: Trajectory) -> list[bool]:
    return np.isfinite(trajectory.T_world_camera).all(axis=(1, 2)).tolist()  # type: ignore[no-any-return]


@pytest.mark.parametrize(
    "word",
    [
        *("", "--.--", "-", "NA", "N/A", "#N/A", "n.a.", "null", "NULL", "(null)", "<NA>", "None"),
        *("nan", "-nan", "-nan(ind)", "1.#QNAN", "#VALUE!", "#DIV/0!", "#REF!", "#NUM!", "#NAME?"),
        *("####", "\\N", "no data", "NODATA", "no fix", "missing", "?", "*", ".", "-9999", "-999"),
        *("—", "–", "n.d.", "N/D", "inf", "-Infinity"),
    ],
)
def test_a_cell_without_a_value_leaves_its_row_out_alone(word: str, tmp_path: Path) -> None:
    text = f"{HEADER}\n{NOON},50,-10,5,0\n{NOON + 1},{word},{word},5,0\n{NOON + 2},50,-10,5,90\n"
    trajectory = read_trajectory(write(tmp_path, text, "nav.csv"))
    assert known(trajectory) == [True, False, True]


def test_the_null_island_is_no_place(tmp_path: Path) -> None:
    assert known(
        read_trajectory(
            write(tmp_path, f"{HEADER}\n{NOON},50,-10,5,0\n{NOON + 1},0,0,5,0\n", "nav.csv")
        )
    ) == [True, False]


@pytest.mark.parametrize("depth", ["depth", "altitudeRelative"])
def test_a_depth_that_is_never_positive_is_a_height(depth: str, tmp_path: Path) -> None:
    text = f"{HEADER.replace('depth', depth)}\n{NOON},50,-10,-5,0\n{NOON + 1},50,-10,-5,0\n"
    trajectory = read_trajectory(write(tmp_path, text, "nav.csv"))
    np.testing.assert_allclose(trajectory.T_world_camera[:, 2, 3], [-5, -5])


def test_a_telemetry_csv_of_qgroundcontrol(tmp_path: Path) -> None:
    header = "Timestamp,roll,pitch,heading,groundSpeed,altitudeRelative,clock.currentTime,clock.currentDate,gps.lat,gps.lon,gps2.lat"  # noqa: E501
    row = "2026-10-16 12:00:0{}.000,0.0,0.0,{},--.--,-5.0,12:00:00,10/16/2026,50,-10,--.--"
    text = "\n".join([header, row.format(0, 0), row.format(1, 90)]) + "\n"
    trajectory = read_trajectory(write(tmp_path, text, "qgc.csv"))
    np.testing.assert_allclose(
        trajectory.T_world_camera[:, :3, :3], [NORTH_UP, EAST_UP], atol=1e-12
    )
    assert trajectory.timestamps_s.tolist() == [NOON, NOON + 1]
    assert trajectory.origin is not None and not trajectory.fixes


@pytest.mark.parametrize(
    ("date", "time"),
    [
        ("16/10/2026", "12:00:00"), ("10/16/2026", "12:00:00"), ("2026-10-16", "12:00"),
        ("16.10.2026", "12:00:00"),
        ("2026/10/16", "12:00:00.0"), ("10/16/2026", "12:00:00 PM"), ("10/16/26", "12:00 pm"),
        ("10-16-2026", "12:00:00 UTC"),
    ],
)  # fmt: skip
def test_dates_apart_or_with_their_time(date: str, time: str, tmp_path: Path) -> None:
    apart = f"date,time,lat,lon,depth,heading\n{date},{time},50,-10,5,0\n"
    together = f"{HEADER}\n{date} {time},50,-10,5,0\n"
    for text in (apart, together):
        assert read_trajectory(write(tmp_path, text, "nav.csv")).timestamps_s.tolist() == [NOON]


def test_one_date_tells_the_order_of_a_column() -> None:
    assert column_seconds(["12/10/2026 0:00:00", "13/10/2026 0:00:00"])[0] == NOON - 4.5 * 86400
    assert column_seconds(["10/12/2026 0:00:00", "10/13/2026 0:00:00"])[0] == NOON - 4.5 * 86400
    assert column_seconds(["10/12/2026 12:00:00 AM"], day_first=False) == [NOON - 4.5 * 86400]
    with pytest.raises(TimeError, match="13/13/2026"):
        column_seconds(["13/13/2026 0:00:00"])


def test_dates_of_open_order_are_refused_until_they_are_named(tmp_path: Path) -> None:
    path = write(
        tmp_path, "date,time,lat,lon,depth,heading\n10/06/2026,12:00:00,50,-10,5,0\n", "nav.csv"
    )
    with pytest.raises(
        InputError,
        match=r"'10/06/2026 12:00:00' may be day/month or month/day: name the columns with date=",
    ):
        read_trajectory(path)
    columns = "time=time,lat=lat,lon=lon,depth=depth,heading=heading"
    found = [
        read_trajectory(Path(f"{path}:{role}=date,{columns}")).timestamps_s[0]
        for role in ("date", "us_date")
    ]
    assert found == [NOON - 128 * 86400, NOON - 10 * 86400]
    with pytest.raises(AmbiguousDateError):
        column_seconds(["1/2/2026 10:00:00", ""])


@pytest.mark.parametrize(
    ("latitude", "longitude"),
    [
        ("14.5 S", "145.25 E"),
        ("14°30'0.0\"S", "145°15'0\"E"),
        ("S 14 30.0", "E 145 15.0"),
        ("14:30:00 S", "145:15 E"),
        ("-14.5°", "145.25°"),
    ],
)
def test_degrees_minutes_and_hemispheres(latitude: str, longitude: str, tmp_path: Path) -> None:
    quoted = [f'"{text.replace(chr(34), 2 * chr(34))}"' for text in (latitude, longitude)]
    trajectory = read_trajectory(
        write(tmp_path, f"{HEADER}\n{NOON},{quoted[0]},{quoted[1]},5,0\n", "nav.csv")
    )
    assert trajectory.origin is not None
    assert (trajectory.origin.latitude_deg, trajectory.origin.longitude_deg) == pytest.approx(
        (-14.5, 145.25)
    )


def test_a_spreadsheets_own_encoding(tmp_path: Path) -> None:
    text = f"{HEADER}\n{NOON},14.5° S,145.25° E,5,0\n"
    for encoding in ("cp1252", "utf-16", "utf-8-sig"):
        (tmp_path / "nav.csv").write_bytes(text.encode(encoding))
        assert read_trajectory(tmp_path / "nav.csv").origin is not None


@pytest.mark.parametrize("columns", ["", ":time=timestamp,north=y,east=x"])
def test_positions_that_are_marked_invalid_are_not_used(columns: str, tmp_path: Path) -> None:
    names = "y,x" if columns else "north,east"
    rows = "".join(f"{NOON + i},{i % 2 == 0},{i},{2 * i}\n" for i in range(4))
    trajectory = read_trajectory(
        Path(
            f"{write(tmp_path, f'timestamp,position_valid,{names}{chr(10)}{rows}', 'a.csv')}{columns}"  # noqa: E501
        )
    )
    assert trajectory.fixes and known(trajectory) == [True, False, True, False]
    np.testing.assert_allclose(trajectory.T_world_camera[2, :2, 3], [4, 2])


@pytest.mark.parametrize(
    ("header", "lacks"),
    [
        (
            "timestamp,heading,roll,pitch",
            r"without lat and lon \(or north and east\), depth \(or up\) \(it has timestamp, "
            r"heading",
        ),
        ("timestamp,depth", r"without lat and lon \(or north and east\), heading"),
        ("latitude,longitude,depth,heading,photo", "holds a header, but no rows"),
        ("timestamp,position_valid,x,y,z", r"without lat and lon"),
        ("timestamp,latitude,longitude,depth,gps_heading", r"is a table without heading \(it has"),
        ("timestamp,depth,heading,roll", r"or give the table with them, too: nav\.csv,other\.csv"),
        (
            "timestamp,latitude,longitude,heading,altitude",
            r"without depth \(or up\).*up=altitude only if that is a height above the water's",
        ),
    ],
)
def test_tables_that_lack_columns_or_rows_name_them(
    header: str, lacks: str, tmp_path: Path
) -> None:
    row = "" if "photo" in header else ",".join(["1"] * header.count(",")) + ",1\n"
    path = write(tmp_path, f"{header}\n{row}", "nav.csv")
    with pytest.raises(InputError, match=lacks):
        read_trajectory(path)
    assert trajectory_format(path) == "table of navigation"  # so that inspect names it


def nmea(body: str) -> str:
    total = 0
    for byte in body.encode():
        total ^= byte
    return f"${body}*{total:02X}\n"


RMC, GGA = (
    "GPRMC,120001.50,A,1430.0000,S,14515.0000,E,0.5,90.0,161026,,,A",
    "GPGGA,120001.50,1430.0000,S,14515.0000,E,4,12,0.8,0.0,M,0.0,M,,",
)
POINT = '<trkpt lat="-14.5" lon="145.25"><ele>0</ele><time>2026-10-16T12:00:01.5Z</time></trkpt>'
GPX = f'<gpx version="1.1"><trk><trkseg>{POINT}</trkseg></trk></gpx>'
KML = (
    "<kml><gx:Track><when>2026-10-16T12:00:01.5Z</when><gx:coord>145.25 -14.5 "
    "0</gx:coord></gx:Track></kml>"
)
LOGS = {
    "RMC and GGA": nmea(GGA) + nmea(RMC) + "\n" + nmea(RMC.replace(",A,", ",V,", 1).replace("1430",
    "1530")),
    "GNS and ZDA": nmea("GPZDA,120001.00,16,10,2026,00,00")
    + nmea("GNGNS,120001.50,1430.0000,S,14515.0000,E,AN,12,0.8,0.0,0.0,,")
    + nmea("GNGNS,120003.50,1430.0000,S,14515.0000,E,NN,12,0.8,0.0,0.0,,"),
    "GGA and ZDA": nmea("GPZDA,120001.00,16,10,2026,00,00") + nmea(GGA) + nmea(GGA.replace(",4,12",
    ",0,00")),
    "with a logger's prefix": f"2026-10-16 12:00:02.1 {nmea(RMC)}",
    "a damaged sentence": nmea(RMC) + nmea(RMC).replace("1430", "1830"),
    "points of KML": "<kml><Placemark><name>a</name></Placemark><Placemark><TimeStamp><when>"
    "2026-10-16T12:00:01.5Z</when></TimeStamp><Point><coordinates>145.25,-14.5,0</coordinates>"
    "</Point></Placemark></kml>",
    "GPX": GPX, "GPX, indented": GPX.replace("><", ">\n  <"), "KML": KML,
}  # fmt: skip


@pytest.mark.parametrize("name", LOGS)
def test_receivers_logs_are_fixes(name: str, tmp_path: Path) -> None:
    fixes = read_trajectory(write(tmp_path, LOGS[name], "log.txt"))
    assert fixes.fixes and fixes.timestamps_s.tolist() == [NOON + 1.5]
    assert fixes.origin is not None
    assert (fixes.origin.latitude_deg, fixes.origin.longitude_deg) == pytest.approx((-14.5, 145.25))


def test_nmea_without_a_date_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no position with a date and time"):
        read_trajectory(write(tmp_path, nmea(GGA), "log.nmea"))


def test_a_reconstruction_of_opensfm(tmp_path: Path) -> None:
    R_camera_world = NORTH_UP.T
    from scipy.spatial.transform import Rotation

    shot = {
        "rotation": Rotation.from_matrix(R_camera_world).as_rotvec().tolist(),
        "capture_time": NOON,
    }
    shot["translation"] = (-R_camera_world @ [1.0, 2.0, -3.0]).tolist()
    whole = [
        {"shots": {}},
        {
            "shots": {"a.jpg": shot},
            "reference_lla": {"latitude": -14.5, "longitude": 145.25, "altitude": -2.0},
        },
    ]
    trajectory = read_trajectory(write(tmp_path, json.dumps(whole), "reconstruction.json"))
    assert trajectory.names == ("a.jpg",) and trajectory.up == "z" and trajectory.origin is not None
    np.testing.assert_allclose(
        trajectory.T_world_camera[0, :3], np.column_stack([NORTH_UP, [1, 2, -5]]), atol=1e-12
    )
    with pytest.raises(InputError, match="no shots with a rotation"):
        read_trajectory(write(tmp_path, '[{"shots": {"a": {}}}]', "reconstruction.json"))


FOREIGN = {
    "dive.ulg": (b"ULog\x01\x12\x35\x01" + bytes(50), "a log of PX4"),
    "dive.BIN": (b"\xa3\x95\x80" + bytes(50), "a log of ArduPilot"),
    "dive.tlog": (bytes(8) + b"\xfd\x1c\x00\x00\x01\x01" + bytes(50), "a telemetry log of MAVLink"),
    "nav.xlsx": (b"PK\x03\x04" + bytes(50), "a spreadsheet or an archive"),
    "track.shp": (b"\x00\x00\x27\x0a" + bytes(96), "a Shapefile"),
    "nav.csv": (b"version https://git-lfs.github.com/spec/v1\noid sha256:5\n", "a pointer of Git"),
    "model.nvm": (b"NVM_V3\n\n2\n", "a model of VisualSFM"),
    "bundle.out": (b"# Bundle file v0.3\n2 0\n", "a model of Bundler"),
    "shots.json": (b'{"type": "FeatureCollection", "features": []}', "a GeoJSON file"),
    "usbl.log": (b"USBLLONG,1.5,1.0,2,10.5,3.5,18.0\n", "a log of an Evologics USBL"),
    "dive.log": (
        b"FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns\n"
        b"FMT, 130, 50, GPS, QBcLLe, TimeUS,Status,HDop,Lat,Lng,Alt\nGPS, 5, 3, 0.9, 14, 145, 2\n",
        "a log of ArduPilot as text",
    ),
    "dump.txt": (b"2026-10-16 12:00:00.50: ATT {Roll : 1.5}\n", "the text that mavlogdump.py"),
    "line.raw": (b"FTP NEW 2\nVER 18\nPOS 0 37230.5 512345.5 4512345.5\n", "raw data of Hypack"),
    "dvl.txt": (b":SA, -2.5, +4.5,209.5\n:TS,26101612000050,35.0\n", "a log of a DVL"),
    "dive.uddf": (b'<?xml version="1.0"?>\n<uddf version="3.2.1">', "a log of depths"),
    "cast.cnv": (b"* Sea-Bird SBE 19\n# name 0 = depSM\n*END*\n  1.5  2.5\n", "a log of depths"),
    "echo.txt": (b"header: \n  seq: 12\n  stamp: \n    secs: 15\n", "the text of rostopic echo"),
    "echo.csv": (b"1792152000,5,odom,base,1.0,2.0,3.0,0.0,0.0,0.0,1.0\n", "the rows of ros2 topic"),
    "geo.txt": (b"EPSG:4326\na.jpg 145.5 -14.5 2.5\n", "positions of images for OpenDroneMap"),
    "opk.txt": (
        b"# Cameras (1)\n# PhotoID, X, Y, Z, Omega, Phi, Kappa, r11, r12, r13, r21, r22, r23, r31, "
        b"r32, r33\na.jpg\t1\t2\t3\t4\t5\t6\t1\t0\t0\t0\t1\t0\t0\t0\t1\n",
        "positions of cameras with omega, phi, kappa",
    ),
    "mission.yaml": (b"version: 1\norigin:\n  latitude: 50.8\n", "a mission file of oplab"),
}


@pytest.mark.parametrize("name", FOREIGN)
def test_foreign_files_are_named_by_read_and_inspect(name: str, tmp_path: Path) -> None:
    content, message = FOREIGN[name]
    (tmp_path / name).write_bytes(content)
    with pytest.raises(InputError, match=f"{name}: is {message}"):
        read_trajectory(tmp_path / name)
    (line,) = unknown_files([tmp_path / name, tmp_path], (), ())
    assert line.startswith("not used: ") and message in line
    assert unknown_files([tmp_path / name], [tmp_path / name], ()) == ()


def test_inspect_names_a_file_of_which_it_knows_nothing(tmp_path: Path) -> None:
    (line,) = unknown_files([write(tmp_path, "hello\n", "notes.txt")], (), ())
    assert line.endswith(
        "notes.txt: is neither images, nor a calibration or trajectory of a known format"
    )
    os.mkfifo(tmp_path / "nav.png")
    (line,) = unknown_files([tmp_path / "nav.png"], (), ())
    assert line.startswith("not used: ") and line.endswith("nav.png: is a named pipe, not a file")


def tables_apart(folder: Path) -> list[Path]:
    """Positions, attitudes and depths as loggers of small vehicles write them, each at its times;
    the heading passes north.
    """
    texts = {
        "position.csv": "timestamp,lat,lon\n"
        + "".join(f"{NOON + i},{50 + 1e-5 * i},-10\n" for i in range(4)),
        "attitude.csv": "timestamp,roll,pitch,yaw\n"
        + "".join(f"{NOON + i / 2 + 0.1},0,0,{(359 + i) % 360}\n" for i in range(6)),
        "depth.csv": "timestamp,depth\n" + "".join(f"{NOON + i - 0.5},{5 + i}\n" for i in range(5)),
    }
    return [write(folder, text, name) for name, text in texts.items()]


def test_tables_of_one_dive_are_joined_by_time(tmp_path: Path) -> None:
    trajectory = read_trajectory(Path(",".join(map(str, tables_apart(tmp_path)))))
    T = trajectory.T_world_camera
    np.testing.assert_allclose(trajectory.timestamps_s - NOON, 0.1 + np.arange(6) / 2, atol=1e-6)
    np.testing.assert_allclose(-T[:, 2, 3], 5.6 + np.arange(6) / 2, atol=1e-6)
    steps_m = np.diff(T[:, 1, 3])
    np.testing.assert_allclose(steps_m, steps_m[0], rtol=1e-3)
    assert 0.5 < steps_m[0] < 0.6  # half of 1e-5 degrees
    np.testing.assert_allclose(T[1, :3, :3], NORTH_UP, atol=1e-9)  # 0 is between 359 and 1
    assert not trajectory.fixes


def test_a_map_of_columns_holds_for_its_own_table(tmp_path: Path) -> None:
    position, attitude, depth = tables_apart(tmp_path)
    depth.write_text(depth.read_text().replace("timestamp,depth", "t,z"))
    given = Path(f"{position},{attitude},{depth}:time=t,depth=z")
    assert all(known(read_trajectory(given)))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda parts: parts[:2], "lack depth"),
        (lambda parts: [parts[0], parts[0], parts[2]], "lack heading"),
    ],
)
def test_tables_that_lack_something_together_are_named(
    change: Callable[[list[Path]], list[Path]], words: str, tmp_path: Path
) -> None:
    with pytest.raises(InputError, match=words):
        read_trajectory(Path(",".join(map(str, change(tables_apart(tmp_path))))))


def test_tables_of_two_dives_have_no_time_in_common(tmp_path: Path) -> None:
    position, attitude, depth = tables_apart(tmp_path)
    depth.write_text(depth.read_text().replace("179", "178"))
    with pytest.raises(InputError, match="no time in common"):
        read_trajectory(Path(f"{position},{attitude},{depth}"))


def test_inspect_offers_tables_that_are_whole_together(tmp_path: Path) -> None:
    parts = tables_apart(tmp_path)
    found, _ = find_poses(parts, (), ())
    assert found[-1].path == Path(",".join(sorted(map(str, parts))))
    assert found[-1].poses == 6
    assert not find_poses(parts[1:], (), ())[0]


def sentence(text: str) -> str:
    total = 0
    for byte in text.encode():
        total ^= byte
    return f"${text}*{total:02X}\n"


def test_headings_and_depths_of_nmea_are_offered_and_taken_where_named(tmp_path: Path) -> None:
    text = "".join(
        sentence(f"GPRMC,12000{i},A,5000.0000,N,01000.0000,W,0.5,0.0,161026,,,A")
        + sentence(f"HEHDT,{90.0 * i},T")
        + sentence(f"SDDPT,{5 + i}.0,0.0")
        for i in range(2)
    )
    path = write(tmp_path, text, "dive.nmea")
    fixes = read_trajectory(path)
    assert fixes.fixes and "dive.nmea:heading=HDT,depth=DPT" in fixes.notes[0]
    vehicle = read_trajectory(Path(f"{path}:heading=HDT,depth=DPT"))
    np.testing.assert_allclose(vehicle.T_world_camera[:, :3, :3], [NORTH_UP, EAST_UP], atol=1e-12)
    np.testing.assert_allclose(vehicle.T_world_camera[:, 2, 3], [-5, -6])
    with pytest.raises(InputError, match="XDR is not one of the supported sentences"):
        read_trajectory(Path(f"{path}:heading=XDR,depth=DPT"))


@pytest.mark.parametrize(
    ("latitude", "step_m"), [("50.00001", 1.11), ("50 0.123", 1.85), ("50.0", 11_100), ("5e1", 0)]
)
def test_what_positions_are_rounded_to_is_known(
    latitude: str, step_m: float, tmp_path: Path
) -> None:
    text = f"{HEADER}\n{NOON},{latitude},-10,5,0\n"
    found = read_trajectory(write(tmp_path, text, "nav.csv"))
    assert found.position_step_m == pytest.approx(step_m, rel=1e-3)


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("$PSONLLD,120000.00,A,-14.6,145.4,5.0,1,1,45,1*00\n" * 3, "Sonardyne USBL .*no date"),
        ("$PSIMSSB,120000.00,B01,A,,C,H,M,1.0,2.0,5.0,0.4,N,,*00\n" * 3, "Kongsberg HiPAP"),
        ("$PSIMLBP,120000.00,1,P,F,C,1.0,2.0,5.0,0.4,0.2\n" * 3, "PSIMLBP"),
        (
            "$GPRMC,120000.00,A,1440.8,S,14527.0,E,0.5,0,010526,,,A\n"
            "$PSIMSSB,120000.00,B01,A,,C,H,M,1.0,2.0,5.0,0.4,N,,\n" * 3,
            r"acoustic beacon \(PSIMSSB\) and of the ship",
        ),
        (
            "$GPZDA,120000.00,,,,00,00\n$PSONLLD,120000.00,B1,A,-14.6,145.4,5.0,1,1,45,1\n" * 3,
            "PSONLLD.*no ZDA or RMC in it gives one",
        ),
        (
            "$GPZDA,120000.00,01,05,2026,00,00\n"
            "$PSONLLD,120000.00,B1,A,-14.6,145.4,5.0,1,1,45,1\n"
            "$PSONLLD,120001.00,B2,A,-14.6,145.4,5.0,1,1,45,1\n",
            r"several beacons \(B1, B2\): keep the lines of the one",
        ),
        ("[Script Info]\nTitle: Cockpit\n\n[Events]\n", "subtitles whose 0 lines"),
        (
            "1\n0:00:01,000 --> 0:00:02,000\n[latitude: 1] [longitude: 2]\n\n" * 3,
            "subtitles whose 3",
        ),
    ],
)
def test_logs_of_small_vehicles_are_named(text: str, what: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=what):
        read_trajectory(write(tmp_path, text, "log.txt"))


def _checked(sentence: str) -> str:
    total = 0
    for byte in sentence.encode():
        total ^= byte
    return f"${sentence}*{total:02X}"


@pytest.mark.parametrize("order", ["name,A", "A", "A,A"])
@pytest.mark.parametrize("date", ["GPZDA,{},31,12,2026,00,00", "GPRMC,{},A,0,N,0,E,0,0,311226,,,A"])
def test_a_beacon_of_sonardyne_over_midnight(order: str, date: str, tmp_path: Path) -> None:
    """The ship, which is reported the same way, and fixes that are not valid, or whose checksum is
    wrong, are passed over.
    """
    clocks = ("235958.50", "235959.50", "000000.50", "000001.50")
    log = [_checked(date.format("235958.00"))]
    for i, clock in enumerate(clocks):
        state = order.replace("name", "2401")
        log += [
            _checked(
                f"PSONLLD,{clock},{state},{-14.6 + i * 1e-5:.6f},145.45,{5 + i}.0,.1,.1,0,.1,,,,"
            ),
            _checked(f"PSONLLD,{clock},Ship 1,A,-14.9,145.0,0.000,0.08,0.08,0.00,0.01,,,,"),
            _checked(f"PSONLLD,{clock},2401,V,-15.9,145.0,9.000,0.08,0.08,0.00,0.01,,,,"),
            _checked(f"PSONLLD,{clock},2401,A,-15.9,145.0,9.000,0.08,0.08,0.00,0.01,,,,")[:-2]
            + "00",
        ]
    trajectory = read_trajectory(write(tmp_path, "\n".join(log) + "\n", "usbl.log"))
    assert trajectory.timestamps_s is not None
    start = datetime(2026, 12, 31, 23, 59, 58, 500_000, tzinfo=UTC).timestamp()
    np.testing.assert_allclose(trajectory.timestamps_s - start, range(4), atol=1e-3)
    places = trajectory.T_world_camera[:, :2, 3]
    steps_m = np.linalg.norm(np.diff(places, axis=0), axis=1)
    np.testing.assert_allclose(steps_m, 1.106, rtol=0.01)


def test_the_depth_of_a_beacon_is_its_own(tmp_path: Path) -> None:
    log = ["$GPZDA,120000.00,01,05,2026,00,00"]
    for i in range(4):
        log += [
            f"$HEHDT,{90 + i}.0,T",
            f"$PSONLLD,12000{i}.00,B1,A,-14.6,{145.4 + i * 1e-5:.5f},{5 + i}.5,1,1,45,1",
        ]
    path = write(tmp_path, "\n".join(log) + "\n", "usbl.log")
    trajectory = read_trajectory(Path(f"{path}:heading=HDT,depth=PSONLLD"))
    np.testing.assert_allclose(trajectory.T_world_camera[:, 2, 3], [-5.5, -6.5, -7.5, -8.5])


@pytest.mark.parametrize("many", [1, 100])
def test_units_of_mavlink(many: int, tmp_path: Path) -> None:
    """GLOBAL_POSITION_INT: 1e-7 and 1e-2 of a degree, millimeters."""
    names = [f"GLOBAL_POSITION_INT.{name}" for name in ("lat", "lon", "relative_alt", "hdg")]
    rows = [
        f"{NOON + i},{-146800000 - 90 * i},1454500000,{-12 * many},{hdg}"
        for i, hdg in enumerate((0, 90 * many, 65535))
    ]
    table = "\n".join([",".join(["timestamp", *names]), *rows, ""])
    trajectory = read_trajectory(write(tmp_path, table, "mavlog.csv"))
    np.testing.assert_allclose(trajectory.T_world_camera[:2, 2, 3], -0.012 * many)
    assert known(trajectory) == [True, True, False]
    assert np.ptp(trajectory.T_world_camera[:2, 1, 3]) == pytest.approx(1.0, rel=0.01)
    assert trajectory.position_step_m == pytest.approx(0.0111)


@pytest.mark.parametrize(
    ("name", "a_second"), [("time_boot_ms", 1e3), ("TimeUS", 1e6), ("timestamp [ns]", 1e9)]
)
def test_units_of_times_are_those_of_their_column(
    name: str, a_second: float, tmp_path: Path
) -> None:
    """Since the epoch, and since a start, whose size tells no unit."""
    for begin_s in (100.0, NOON):
        rows = [f"{int((begin_s + i) * a_second)},50,-10,5,0" for i in range(3)]
        text = "\n".join([HEADER.replace("timestamp", name), *rows, ""])
        times_s = read_trajectory(write(tmp_path, text, "nav.csv")).timestamps_s
        np.testing.assert_allclose(times_s - begin_s, [0, 1, 2], atol=1e-5)


def test_angles_of_mavlink_are_in_radians(tmp_path: Path) -> None:
    """Those of ATTITUDE beside whole numbers of GLOBAL_POSITION_INT."""
    header = "timestamp,GPS_RAW_INT.lat,GPS_RAW_INT.lon,AHRS2.x,GLOBAL_POSITION_INT.relative_alt"
    header += ",ATTITUDE.roll,ATTITUDE.pitch,ATTITUDE.yaw"
    table = f"{header}\n{NOON},-146800000,1454500000,0,-5000,0,0,0\n"
    table += f"{NOON + 1},-146800090,1454500000,0,-5000,0,0,1.5707963\n"
    first, second = read_trajectory(write(tmp_path, table, "mavlog.csv")).T_world_camera[:, :3, :3]
    clockwise = [[0, 1, 0], [-1, 0, 0], [0, 0, 1]]
    np.testing.assert_allclose(second @ first.T, clockwise, atol=1e-6)


def test_angles_that_come_with_speeds_are_in_radians(tmp_path: Path) -> None:
    """Those of the message ATTITUDE in a table of its own, joined with one of positions."""
    rows = "\n".join(f"{NOON + i},{-14.5 + 1e-5 * i},145.25,5" for i in range(3))
    position = write(tmp_path, f"timestamp,lat,lon,depth\n{rows}\n", "position.csv")
    rows = "\n".join(f"{NOON + i},0,0,{i * np.pi / 2},0,0,0" for i in range(3))
    names = "timestamp,roll,pitch,yaw,rollspeed,pitchspeed,yawspeed"
    attitude = write(tmp_path, f"{names}\n{rows}\n", "attitude.csv")
    T = read_trajectory(Path(f"{position},{attitude}")).T_world_camera
    np.testing.assert_allclose(T[:2, :3, :3], [NORTH_UP, EAST_UP], atol=1e-9)


def test_a_column_that_calls_no_row_valid_is_named(tmp_path: Path) -> None:
    path = write(tmp_path, f"{HEADER},quality\n{NOON},-14.5,145.25,5,0,0\n", "nav.csv")
    with pytest.raises(InputError, match="column 'quality' says of all rows"):
        read_trajectory(path)


def test_json_without_records_is_named(tmp_path: Path) -> None:
    text = '{"streams": {"GPS5": [{"value": [1, 2]}, {"value": [3, 4]}]}}'
    path = write(tmp_path, text, "gps.json")
    with pytest.raises(InputError, match="is JSON without a list of records"):
        read_trajectory(path)


def test_a_table_of_unknown_columns_is_named_with_them(tmp_path: Path) -> None:
    table = "log_time,ts,a,b,c,status\n2026-10-16T12:00:00Z,1792152000,1,2,3,0\n"
    with pytest.raises(InputError, match=r"known by their names \(log_time, ts, a, b, c, status\)"):
        read_trajectory(write(tmp_path, table, "nav.csv"))


def test_a_table_of_images_below_a_comment_is_named(tmp_path: Path) -> None:
    """Also with the image_name of ORCA."""
    table = "# dive 3\nimage_name,latitude,longitude,depth\na,-14.5,145.25,5\n"
    with pytest.raises(InputError, match="is a table without heading"):
        read_trajectory(write(tmp_path, table, "images.csv"))
    with pytest.raises(InputError, match=r"known by their names \(place, p, q, r\)"):
        read_trajectory(write(tmp_path, "# dive 3\nplace,p,q,r\n1,2,3,4\n", "places.csv"))


def test_an_inertial_navigation_system_is_named(tmp_path: Path) -> None:
    text = nmea("HEHDT,12.00,T") + nmea("PIXSE,POSITI,-14.68,145.45,-5.0")
    with pytest.raises(InputError, match=r"inertial navigation system \(PIXSE\).*CSV"):
        read_trajectory(write(tmp_path, text, "phins.txt"))
