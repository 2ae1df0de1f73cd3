"""Tables of navigation that no format is known of, read by a map of their columns."""

from pathlib import Path

import numpy as np
import pytest
from test_trajectories import EAST_UP, NORTH_UP, write

from stereo_seecolor.config import MountConfig
from stereo_seecolor.errors import InputError
from stereo_seecolor.inputs.trajectories import read_trajectory, trajectory_files

NAV = "Stamp,Lat (deg),Lon (deg),D,Hdg,File\n1000.5,50,-10,5,0,a.png\n1001.5,50,-10,5,90,b.png\n"
MAP = "time=Stamp,lat=Lat (deg),lon=Lon (deg),depth=D,heading=Hdg"


def spec(path: Path, columns: str) -> Path:
    return Path(f"{path}:{columns}")


def test_a_table_by_its_columns(tmp_path: Path) -> None:
    path = write(tmp_path, NAV, "nav.csv")
    trajectory = read_trajectory(spec(path, f"{MAP},name=File"))
    assert trajectory.names == ("a.png", "b.png")
    assert trajectory.timestamps_s.tolist() == [1000.5, 1001.5]
    np.testing.assert_allclose(
        trajectory.T_world_camera[:, :3, :3], [NORTH_UP, EAST_UP], atol=1e-12
    )
    np.testing.assert_allclose(trajectory.T_world_camera[:, :3, 3], [[0, 0, -5]] * 2, atol=1e-9)
    assert trajectory.origin is not None
    assert trajectory_files(spec(path, MAP)) == (path,)
    assert trajectory_files(path) == (path,)


def test_decimal_commas_between_semicolons(tmp_path: Path) -> None:
    commas = (
        NAV.replace(",", ";")
        .replace("1000.5", "1000,5")
        .replace("-10", "-10,0")
        .replace("1001.5", "1001,5")
    )
    read = [read_trajectory(spec(write(tmp_path, text, "nav.csv"), MAP)) for text in (NAV, commas)]
    np.testing.assert_array_equal(read[1].T_world_camera, read[0].T_world_camera)
    assert read[1].timestamps_s.tolist() == [1000.5, 1001.5]


@pytest.mark.parametrize(
    ("place", "what"), [("152,-23", "latitudes reach 152"), ("50,-1000", "longitudes reach 1000")]
)
def test_degrees_that_cannot_be_are_refused(tmp_path: Path, place: str, what: str) -> None:
    path = write(tmp_path, NAV.replace("50,-10", place), "nav.csv")
    with pytest.raises(InputError, match=f"{what} degrees: are latitude and longitude exchanged"):
        read_trajectory(spec(path, MAP))


def test_places_alone_are_fixes(tmp_path: Path) -> None:
    path = write(tmp_path, NAV, "nav.csv")
    fixes = read_trajectory(
        spec(path, "time=Stamp,lat=Lat (deg),lon=Lon (deg)"), MountConfig(xyz_m=(2, 0, 0))
    )
    assert fixes.fixes and fixes.origin is not None
    np.testing.assert_allclose(fixes.T_world_camera[:, :3, 3], np.zeros((2, 3)), atol=1e-9)
    assert not read_trajectory(spec(path, MAP)).fixes


def test_meters_north_and_east_heights_and_the_mount(tmp_path: Path) -> None:
    path = write(
        tmp_path, '"north";"east";"height";"psi";"theta";"name"\n2;1;-3;0;10;"a;b.png"\n', "nav.txt"
    )
    columns = "north=north,east=east,up=height,heading=psi,pitch=theta,name=NAME"
    trajectory = read_trajectory(spec(path, columns), MountConfig(xyz_m=(1, 0, 0)))
    angle = np.radians(10)
    # bow up by 10 degrees: a camera 1 m forward is cos 10 further north and sin 10 higher, and
    # looks backward a little
    np.testing.assert_allclose(
        trajectory.T_world_camera[0, :3, 3], [1, 2 + np.cos(angle), -3 + np.sin(angle)], atol=1e-12
    )
    np.testing.assert_allclose(
        trajectory.T_world_camera[0, :3, 2], [0, np.sin(angle), -np.cos(angle)], atol=1e-12
    )
    assert trajectory.names == ("a;b.png",)
    assert trajectory.origin is None
    assert np.isnan(trajectory.timestamps_s).all()


def test_heights_above_zero_stay_heights(tmp_path: Path) -> None:
    """A lake, or heights above the ellipsoid."""
    path = write(tmp_path, "t,n,e,h,psi\n1000,0,0,1501.5,0\n1001,1,0,1502,0\n", "nav.csv")
    trajectory = read_trajectory(spec(path, "time=t,north=n,east=e,up=h,heading=psi"))
    np.testing.assert_allclose(trajectory.T_world_camera[:, 2, 3], [1501.5, 1502])


@pytest.mark.parametrize(
    "time",
    [
        "1577923201.5",
        "1577923201500",
        "1577923201500000",
        "1577923201500000000",
        "2020-01-02T00:00:01.5Z",
        "2020-01-02 00:00:01.5",
    ],
)
def test_times_of_every_unit(tmp_path: Path, time: str) -> None:
    path = write(tmp_path, f"t,x,y,z,h\n{time},0,0,0,0\n", "nav.csv")
    found = read_trajectory(spec(path, "time=t,east=x,north=y,depth=z,heading=h")).timestamps_s
    assert found.tolist() == pytest.approx([1577923201.5])


def test_date_and_time_apart(tmp_path: Path) -> None:
    path = write(tmp_path, "day\ttime\tx\ty\tz\th\n02/01/2020\t00:00:01.5\t0\t0\t0\t0\n", "nav.tsv")
    found = read_trajectory(
        spec(path, "date=day,time=time,east=x,north=y,depth=z,heading=h")
    ).timestamps_s
    assert found.tolist() == [1577923201.5]


def test_what_is_empty_has_no_pose(tmp_path: Path) -> None:
    path = write(tmp_path, NAV + "1002.5,50,-10,,90,c.png\n", "nav.csv")
    assert np.isfinite(read_trajectory(spec(path, MAP)).T_world_camera).all(
        axis=(1, 2)
    ).tolist() == [True, True, False]


@pytest.mark.parametrize(
    ("columns", "message"),
    [
        (
            "time=Stamp,lat=Lat (deg)",
            r"lacks lat and lon \(or north and east\), depth \(or up\), heading: write nav.csv:",
        ),
        ("lat=Lat (deg),lon=Lon (deg),depth=D,heading=Hdg", r"lacks time \(or name\)"),
        (MAP + ",speed=V", "'speed=V' is not a role=column"),
        (MAP + ",time=V", "'time=V' is not a role=column with a known, unused role"),
        (MAP + ",roll", "'roll' is not a role=column"),
        (MAP + ",roll=Hd", r"has no column 'Hd' for roll; did you mean 'hdg'\?"),
        (MAP + ",roll=inclination", "has no column 'inclination' for roll; it has stamp, lat"),
        (MAP.replace("time=Stamp", "time=File"), r"line 2: no time in 'a\.png'"),
        (MAP.replace("heading=Hdg", "heading=File"), r"line 2: expected numbers, got 'a\.png'"),
    ],
)
def test_maps_that_cannot_be_used(tmp_path: Path, columns: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        read_trajectory(spec(write(tmp_path, NAV, "nav.csv"), columns))


def test_a_table_without_rows(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="holds a header, but no rows"):
        read_trajectory(spec(write(tmp_path, NAV.splitlines()[0] + "\n", "nav.csv"), MAP))


def test_a_missing_table(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"nav\.csv: cannot be read: No such file"):
        read_trajectory(spec(tmp_path / "nav.csv", MAP))


@pytest.mark.parametrize(
    "header",
    [
        "Timestamp,Latitude,Longitude,Depth,Heading,Filename",
        "utc_time,lat_deg,lon_deg,depth_m,hdg,image",
        "% time;Lat [deg];Long (deg);Depth [m];Yaw (deg);file_name",
        "Zeit;Breite;Laenge;Tiefe;Kurs;Image",
    ],
)
def test_usual_names_need_no_map(tmp_path: Path, header: str) -> None:
    separator = ";" if ";" in header else ","
    rows = NAV.splitlines()[1:]
    guessed = read_trajectory(
        write(tmp_path, "\n".join([header, *rows]).replace(",", separator), "nav.csv")
    )
    np.testing.assert_allclose(guessed.T_world_camera[:, :3, :3], [NORTH_UP, EAST_UP], atol=1e-12)
    np.testing.assert_allclose(guessed.T_world_camera[:, :3, 3], [[0, 0, -5]] * 2, atol=1e-9)
    assert guessed.timestamps_s.tolist() == [1000.5, 1001.5]
    assert guessed.names == ("a.png", "b.png")


def test_radians_are_told_by_the_name(tmp_path: Path) -> None:
    table = NAV.replace("Hdg", "heading_rad").replace(",90,", f",{np.pi / 2},")
    trajectory = read_trajectory(
        spec(write(tmp_path, table, "nav.csv"), MAP.replace("Hdg", "heading_rad"))
    )
    np.testing.assert_allclose(trajectory.T_world_camera[:, :3, :3], [NORTH_UP, EAST_UP], atol=1e-9)


def test_two_columns_of_one_name_are_refused_where_they_differ(tmp_path: Path) -> None:
    head, rows = "time,north,east,depth,Depth,heading", ["1,0,0,5,{},90", "2,1,0,6,{},90"]
    for depths, differ in (((5, 6), False), ((50, 60), True)):
        cells = (row.format(depth) for row, depth in zip(rows, depths, strict=True))
        path = write(tmp_path, "\n".join([head, *cells]), "nav.csv")
        if not differ:
            assert read_trajectory(path).T_world_camera[1, 2, 3] == -6
            continue
        with pytest.raises(InputError, match="has several columns 'depth', which differ"):
            read_trajectory(path)


def test_a_table_without_a_heading_says_so(tmp_path: Path) -> None:
    with pytest.raises(
        InputError,
        match=r"is a table without heading .*: name its columns as in nav.*"
        r"its positions alone: nav.csv:time=Stamp,lat=Lat .*,lon=Lon ",
    ):
        read_trajectory(
            write(tmp_path, NAV.replace("Hdg", "Altitude").replace("D,", "Depth,"), "nav.csv")
        )


def test_a_table_of_places_without_a_time_says_what_it_lacks(tmp_path: Path) -> None:
    path = write(tmp_path, "lat,lon,depth\n-14,145,5\n-14,145,5", "nav.csv")
    with pytest.raises(InputError, match=r"is a table without heading, time \(or name\) \(it has"):
        read_trajectory(path)


def test_a_column_map_with_a_depth_and_no_heading_says_so(tmp_path: Path) -> None:
    path = write(tmp_path, "t,la,lo,d\n1,-14,145,5\n2,-14,145,5", "nav.csv")
    with pytest.raises(InputError, match=r"lacks heading.*alone: nav.csv:time=t,lat=la,lon=lo$"):
        read_trajectory(spec(path, "time=t,lat=la,lon=lo,depth=d"))


def test_positions_that_a_receiver_repeats_are_read_as_they_change(tmp_path: Path) -> None:
    rows = [f"{t},{4 * (t // 4)},0,5,90" for t in range(1, 41)]
    track = read_trajectory(
        write(tmp_path, "\n".join(["time,north,east,depth,heading", *rows]), "nav.csv")
    )
    moved_m = np.diff(track.T_world_camera[4:36, 1, 3])
    np.testing.assert_allclose(moved_m, 1.0)
    assert track.notes == (
        "the positions repeat for up to 4.0 s: each is one fix, at its first row, and after the "
        "last one nothing is known",
    )
    assert track.fixes_s is not None and track.fixes_s.tolist() == [1, *range(4, 41, 4)]


def test_positions_of_a_table_of_poses_that_repeats_them_are_fixes_too(tmp_path: Path) -> None:
    """Heights that the table measures at every row stay as they are."""
    rows = [f"{t} {4 * (t // 4)} 0 {-5 - 0.1 * t:.1f} 1 0 0 0" for t in range(1, 41)]
    track = read_trajectory(write(tmp_path, "\n".join(rows), "track.tum"))
    np.testing.assert_allclose(np.diff(track.T_world_camera[4:36, 0, 3]), 1.0)
    np.testing.assert_allclose(np.diff(track.T_world_camera[:, 2, 3]), -0.1)
    assert track.fixes_s is not None and track.notes


def test_positions_in_a_table_of_their_own_are_fixes_before_tables_are_joined(
    tmp_path: Path,
) -> None:
    places = [f"{t},{4 * (t // 4)},0" for t in range(41)]
    write(tmp_path, "\n".join(["time,north,east", *places]), "place.csv")
    angles = [f"{t / 4},5,90,0,0" for t in range(161)]
    write(tmp_path, "\n".join(["time,depth,heading,pitch,roll", *angles]), "angles.csv")
    track = read_trajectory(Path(f"{tmp_path / 'place.csv'},{tmp_path / 'angles.csv'}"))
    np.testing.assert_allclose(np.diff(track.T_world_camera[:160, 1, 3]), 0.25)


def test_between_positions_repeated_for_too_long_nothing_is_known(tmp_path: Path) -> None:
    rows = [f"{t},{12 * (t // 12)},0,5,90" for t in range(60)]
    track = read_trajectory(
        write(tmp_path, "\n".join(["time,north,east,depth,heading", *rows]), "nav.csv")
    )
    north_m = track.T_world_camera[:, 1, 3]
    np.testing.assert_allclose(north_m[[0, 1, 11, 12, 13]], [0, 1, 11, 12, 13])
    assert np.isnan(north_m[2:11]).all()
    (note,) = track.notes
    assert note.startswith("the positions repeat for up to 12.0 s: each is one fix")
    assert note.endswith("nor between 4 pairs of more than 10 s")


def test_positions_of_a_vehicle_that_rests_stay(tmp_path: Path) -> None:
    rows = [f"{t},{min(t, 10)},0,5,90" for t in range(1, 41)]
    track = read_trajectory(
        write(tmp_path, "\n".join(["time,north,east,depth,heading", *rows]), "nav.csv")
    )
    assert track.T_world_camera[-1, 1, 3] == 10 and not track.notes
