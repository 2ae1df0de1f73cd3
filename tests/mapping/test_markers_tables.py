"""Tables of scale bars and surveyed places, as crews and other programs write them; places that
cannot be right.
"""

from pathlib import Path

import numpy as np
import pytest

from calibration.transforms import rigid_transform, rotation_from_vector, transform_points
from stereo_seecolor.earth import degrees_from_north_east
from stereo_seecolor.errors import InputError, MappingError
from stereo_seecolor.mapping.control_points import control_fit
from stereo_seecolor.mapping.marker_placing import PlacedSighting
from stereo_seecolor.mapping.marker_tables import Places, read_bars, read_places
from stereo_seecolor.mapping.placed_markers import PlacedMarker
from stereo_seecolor.mapping.survey import Placement
from stereo_seecolor.mapping.track.fiducials import Marks
from stereo_seecolor.mapping.track.marker_fit import at_places
from stereo_seecolor.records import GeoOrigin

BARS = {
    "this program's": "first,second,length_m\n1,2,0.5\n3,4,0.75\n",
    "centimeters": "first,second,length_cm\n1,2,50\n3,4,75\n",
    "millimeters in brackets": "First point,Second point,Length (mm)\n1,2,500\n3,4,750\n",
    "semicolons and decimal commas": "first;second;length_m\n1;2;0,5\n3;4;0,75\n",
    "inches": "first,second,length_in\n1,2,19.685039370\n3,4,29.527559055\n",
    "feet": "tag1,tag2,length (ft)\n1,2,1.640419948\n3,4,2.460629921\n",
    "German": "von;bis;Länge (m)\n1;2;0,5\n3;4;0,75\n",
    "remarks above": "# bars of the site\nA,B,L\n1,2,0.5\n3,4,0.75\n",
    "units below and spaces": "first second length\n- - m\n1 2 0.5\n3 4 0.75\n",
    "units in cells": "first,second,length\n1,2,50 cm\n3,4,0.75m\n",
    "no header": "1,2,0.5,0.01\n3,4,0.75,0.01\n",
    "ReefShape's template, filled in": "target 1,target 2,0.5,0.01\r\ntarget 3,target "
    "4,0.75,0.01\r\n",
    "ReefShape's words above": "[first point],[second point],[measured distance in "
    "meters]\n1,2,0.5\n3,4,0.75\n",
    "Metashape's": "#Label,Distance (m),Accuracy (m)\ntarget 1_target 2,0.5,0.001\ntarget "
    "3_target 4,0.75,0.001\n",
    "remarks below": "#Label,Distance (m)\n1_2,0.5\n3_4,0.75\n# Total Error,0.001\n",
    "RealityCapture's numbers": "36h11:001,36h11:002,0.5\n36h11:003,36h11:004,0.75\n",
    "tabs and a byte order mark": "\ufefffirst\tsecond\tdistance_m\ntag36h11_1\ttag36h11_2\t0.5\ntag36h11_3\ttag36h11_4\t0.75\n",  # noqa: E501
}


@pytest.mark.parametrize("name", BARS)
def test_scale_bars(name: str, tmp_path: Path) -> None:
    (tmp_path / "bars.csv").write_text(BARS[name], encoding="utf-8")
    assert read_bars(tmp_path / "bars.csv") == {
        (1, 2): pytest.approx(0.5),
        (3, 4): pytest.approx(0.75),
    }


def test_a_unit_that_is_not_known_is_named(tmp_path: Path) -> None:
    (tmp_path / "bars.csv").write_text("first,second,length (yd)\n1,2,0.5\n")
    with pytest.raises(InputError, match=r"'length \(yd\)': its unit is unknown: write m"):
        read_bars(tmp_path / "bars.csv")


def test_rows_of_single_digits_are_no_line_of_units(tmp_path: Path) -> None:
    (tmp_path / "places.csv").write_text("marker,x,y,z\n1,0,0,-5\n2,1,0,-5\n3,0,1,-6\n")
    assert sorted(read_places(tmp_path / "places.csv").points) == [1, 2, 3]


def test_numbers_of_realitycapture_are_hexadecimal_and_those_of_ros_are_not(tmp_path: Path) -> None:
    file = tmp_path / "places.csv"
    file.write_text('"36h11:00e" 0 0 -5\n"36h11:011" 1 0 -5\ntag36h11:123 0 1 -6\n')
    assert sorted(read_places(file).points) == [14, 17, 123]


PLACES = {
    "UTM and a reduced level": "Name,UTM_E,UTM_N,RL\n1,100,200,-8\n2,103,204,-8.5\n",
    "this program's": "marker,x_m,y_m,z_m\n1,100,200,-8\n2,103,204,-8.5\n",
    "with a note and errors": "marker,x_m,y_m,z_m,std_m,note\n1,100,200,-8,0.01,by "
    "tape\n2,103,204,-8.5,0.01,\n",
    "no header": "1,100,200,-8\n2,103,204,-8.5\n",
    "Metashape's": "#Label,X/Easting,Y/Northing,Z/Altitude\ntarget 1,100,200,-8\ntarget "
    "2,103,204,-8.5\n",
    "eastings and depths": "Marker;Easting [m];Northing [m];Depth "
    "[m]\n1;100,0;200,0;8,0\n2;103,0;204,0;8,5\n",
    "a surveyor's": "Point ID;E (m);N (m);H (m)\n1;100;200;-8\n2;103;204;-8,5\n",
    "German": "Punkt,Rechtswert,Hochwert,Höhe\n1,100,200,-8\n2,103,204,-8.5\n",
    "spaces": "1 100 200 -8\n2 103 204 -8.5\n",
    "centimeters": "marker,x_cm,y_cm,z_cm\n1,10000,20000,-800\n2,10300,20400,-850\n",
}


@pytest.mark.parametrize("name", PLACES)
def test_surveyed_places(name: str, tmp_path: Path) -> None:
    (tmp_path / "points.csv").write_text(PLACES[name])
    places = read_places(tmp_path / "points.csv")
    assert places.points.keys() == {1, 2} and places.origin is None
    np.testing.assert_allclose(places.points[2] - places.points[1], [3, 4, -0.5])
    np.testing.assert_allclose(places.points[1], [100, 200, -8])
    assert places.stds_m == {1: 0.01, 2: 0.01}


def test_latitudes_and_longitudes_become_meters(tmp_path: Path) -> None:
    origin = GeoOrigin(12.15, -68.28)
    rows = ""
    for number, (north_m, east_m) in {1: (0.0, 0.0), 2: (4.0, 3.0)}.items():
        latitude, longitude = degrees_from_north_east(north_m, east_m, origin)
        rows += f"target {number},{latitude:.9f},{longitude:.9f},-8.5,0.02,0.03\n"
    (tmp_path / "gis.csv").write_text(
        f"gis_label,gis_lat,gis_lon,Marker Depth (m),xyAcc,zAcc\n{rows}"
    )
    places = read_places(tmp_path / "gis.csv")
    assert places.origin is not None and (
        places.origin.latitude_deg,
        places.origin.longitude_deg,
    ) == pytest.approx((12.15, -68.28))
    np.testing.assert_allclose(places.points[2], [3, 4, -8.5], atol=1e-3)
    assert places.stds_m[2] == 0.03
    (tmp_path / "metashape.txt").write_text(
        f"#Label,Y/Latitude,X/Longitude,Z/Altitude,Accuracy_X/Y_(m),Accuracy_Z_(m)\n{rows}"
    )
    again = read_places(tmp_path / "metashape.txt")
    np.testing.assert_array_equal(again.points[2], places.points[2])
    assert again.stds_m == places.stds_m
    elsewhere = read_places(
        tmp_path / "gis.csv", GeoOrigin(*degrees_from_north_east(-10.0, 20.0, origin))
    )
    np.testing.assert_allclose(elsewhere.points[1], [-20, 10, -8.5], atol=1e-3)


@pytest.mark.parametrize(
    ("read", "text", "message"),
    [
        (read_bars, "1,2,50\n", "line 1: a scale bar of 50 m: name its unit"),
        (read_bars, "target a,target b,0.5,0.01\n",
        "line 1: 'target a' is not a number of a marker"),
        (read_bars, "#Label,Distance (m)\ntarget 1,0.5\n",
        "line 2: 'target 1' does not name two markers"),
        (read_bars, "first,second,how far\n1,2,3\n",
        "has no column 'length_m' .it has first, second, how far"),
        (read_bars, "first,second,length_m\n1,2\n", "line 2: has too few columns"),
        (read_places, "marker,x_m,y_m\n1,2,3\n",
        "has no column 'z_m' .*or marker, lat, lon, depth_m"),
        (read_places, "marker,x_m,y_m,z_m\n1,2,3,\n", "line 2: a number is missing"),
        (read_places, "marker,x_m,y_m,z_m\n1,-68.28,12.15,-8\n2,-68.279995,12.150003,-8\n",
        "if x and y are degrees, name"),
        (read_places, "", "holds no rows"),
    ],
)  # fmt: skip
def test_tables_that_cannot_be_used_name_the_line(
    read, text: str, message: str, tmp_path: Path
) -> None:  # type: ignore[no-untyped-def]
    (tmp_path / "table.csv").write_text(text)
    with pytest.raises(InputError, match=message):
        read(tmp_path / "table.csv")


FLAT = {
    1: (-0.9, 0.35, -1.5),
    2: (-0.3, -0.3, -1.5),
    3: (0.35, 0.3, -1.5),
    4: (0.9, -0.3, -1.5),
    5: (0.0, 0.8, -1.5),
}
MARKERS = [PlacedMarker(number, 4, *place, 0.002, 0.2, 0.001) for number, place in FLAT.items()]
SURVEYED = rigid_transform(rotation_from_vector(np.array([0.0, 0.0, 1.0])), [100.0, 200.0, -8.0])
CAMERAS = np.tile(np.eye(4), (3, 1, 1))


def surveyed() -> dict[int, np.ndarray]:
    return {number: transform_points(SURVEYED, np.array(place)) for number, place in FLAT.items()}


def test_a_mistyped_place_is_named_and_right_ones_are_not() -> None:
    places = surveyed()
    assert control_fit(MARKERS, places).doubt == ""
    places[3][1] += 1.0
    assert control_fit(MARKERS, places).doubt.startswith(
        "marker 3 lies 1.000 m from its position according to the others"
    )
    three = {number: places[number] for number in (1, 2, 3)}
    assert "standard errors: are all given positions correct?" in control_fit(MARKERS, three).doubt
    assert control_fit(MARKERS, three, dict.fromkeys(three, 1.0)).doubt == "", (
        "within their standard errors"
    )


@pytest.mark.parametrize("exchange", ["axes", "markers"])
def test_places_that_turn_the_map_upside_down_are_refused(exchange: str) -> None:
    places = surveyed()
    assert not control_fit(MARKERS, places).is_upside_down(MARKERS, CAMERAS)
    if exchange == "axes":
        places = {number: place[[1, 0, 2]] for number, place in places.items()}
    else:
        places = {1: places[2], 2: places[1], 4: places[4]}
    assert control_fit(MARKERS, places).is_upside_down(MARKERS, CAMERAS)
    corners = np.array([[-0.1, -0.1, 0], [0.1, -0.1, 0], [0.1, 0.1, 0], [-0.1, 0.1, 0]])
    own = [PlacedSighting(number, "", np.array(place) + corners) for number, place in FLAT.items()]
    marks = Marks(
        dict.fromkeys(range(3), own), None, {}, Places(places, dict.fromkeys(places, 0.01))
    )
    with pytest.raises(
        MappingError, match="the surveyed positions put the bottom above the cameras"
    ):
        at_places(marks, Placement(CAMERAS, np.zeros(3, np.int64)))
