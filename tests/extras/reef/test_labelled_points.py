"""CoralNet's annotations on a map: pixels of tiles and frames at their places, and the cover of
their labels.
"""

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import rasterio
from mapping_scene import flat_frames, write_map

from stereo_seecolor.errors import InputError
from stereo_seecolor.extras.export import mosaic_tiles
from stereo_seecolor.extras.export.command import export
from stereo_seecolor.extras.reef.labelled_points import LabelledPoint, on_map, read_points, wilson
from stereo_seecolor.extras.reef.metrics import metrics
from stereo_seecolor.extras.reef.reef_texts import metrics_text
from stereo_seecolor.mapping.raster.grid import Grid
from stereo_seecolor.run_folder.posed_run import PosedRun, open_posed_run

HEAD = "Name,Row,Column,Label\n"


@pytest.fixture(scope="module")
def fused(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A map of a flat bottom; read only."""
    return write_map(tmp_path_factory.mktemp("points") / "out", flat_frames(3), "prior")


@pytest.fixture(scope="module")
def posed(fused: Path) -> PosedRun:
    return open_posed_run(fused)


def test_a_pixel_of_a_tile_lies_where_the_tile_says(
    fused: Path, posed: PosedRun, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(mosaic_tiles, "MOST_PX", 31)
    export(fused, "tiles", tmp_path / "to")
    with (tmp_path / "to/tiles.csv").open() as file:
        tiles = list(csv.DictReader(file))
    rows = [f"{tile['name']},2,{number},T{number}\n" for number, tile in enumerate(tiles)]
    (tmp_path / "annotations.csv").write_text(HEAD + "".join(rows))
    found = read_points(tmp_path / "annotations.csv", posed)
    assert len(found) == len(tiles) > 3
    for number, (point, tile) in enumerate(zip(found, tiles, strict=True)):
        meters = float(tile["meters_per_pixel"])
        x_m = float(tile["west_m"]) + (number + 0.5) * meters
        y_m = float(tile["north_m"]) - 2.5 * meters
        np.testing.assert_allclose(
            (point.x_m, point.y_m), (x_m, y_m) - posed.offset_m[:2], atol=1e-4
        )


def test_a_pixel_of_a_frame_lies_where_the_frame_saw_it(posed: PosedRun, tmp_path: Path) -> None:
    """Below the camera in the middle, and as far from there as the focal length and the depth
    tell.
    """
    geometry = posed.geometry
    x, y = round(geometry.cx_left_px), round(geometry.cy_px)
    file = tmp_path / "annotations.csv"
    file.write_text(f"{HEAD}f1.png,{y},{x},below\nf1.png,{y},{x + 10},beside\nf1.png,{y},{x},\n")
    below, beside = read_points(file, posed)
    number = [frame.name for frame in posed.frames].index("f1")
    depth_m = np.nanmedian(geometry.depth_from_range(posed.measured_range_m(posed.frames[number])))
    pixel_m = depth_m / geometry.focal_px
    at = posed.T_map_camera[number][:2, 3]
    assert np.linalg.norm((below.x_m, below.y_m) - at) < pixel_m
    apart = np.hypot(beside.x_m - below.x_m, beside.y_m - below.y_m)
    assert apart == pytest.approx(10 * pixel_m, rel=0.02)


@pytest.mark.parametrize(
    ("text", "encoding"),
    [
        ("name,row,column,label\nf1.png,2,30,a\nf1.png,7,5,b\n", "utf-8"),
        ("NAME,ROW,COLUMN,LABEL CODE,Label ID\r\nf1,2,30,a,8\r\nf1.JPG,7,5,b,9\r\n", "utf-8-sig"),
        ("Row,Column,Name,Label ID\n2,30,f1.png,a\n7,5,f1.png,b\n", "utf-8"),
        ("Name;Row;Column;Label;Annotator\r\nf1.png;2;30;a;Müller\r\nf1;7;5;b;\r\n", "cp1252"),
        ("Name\tRow\tColumn\tLabel\nc/f1.png\t2\t30\ta\nD:\\c\\f1.png\t7\t5\tb\n", "utf-16"),
        (
            "Name,Comments,Row,Column,Label,Label code,Machine suggestion 1,Machine confidence 1\n"
            'f1.png,"two\nlines, one comma",2,30,a,,Sand,93\nf1.png,,7.0,5.0, ,b,Sand,7\n,,,,,,,\n',
            "utf-8",
        ),
        (
            "Name , Path, Row,Column,Patch Size,Label,Long Label,Verified\n"
            "f1.png,C:/f1.png,2,30, a ,Alga,True\nf1.png,C:/f1.png,7,5,b,Bare,False\n".replace(
                ",30,", ",30,224,"
            ).replace(",5,", ",5,224,"),
            "utf-8",
        ),
    ],
)
def test_tables_are_read_as_coralnet_and_spreadsheets_write_them(
    posed: PosedRun, tmp_path: Path, text: str, encoding: str
) -> None:
    (tmp_path / "plain.csv").write_text(HEAD + "f1.png,2,30,a\nf1.png,7,5,b\n")
    (tmp_path / "other.csv").write_bytes(text.encode(encoding))
    assert read_points(tmp_path / "other.csv", posed) == read_points(tmp_path / "plain.csv", posed)


def test_a_point_that_is_listed_twice_counts_once(posed: PosedRun, tmp_path: Path) -> None:
    """Else its fraction would seem surer than it is; empty rows are those of spreadsheets."""
    text = "f1.png,2,30,a\nf1.png,7,5,b\n"
    (tmp_path / "once.csv").write_text(HEAD + text)
    (tmp_path / "twice.csv").write_text(HEAD + text + text + ",,,\n , ,,\n")
    assert read_points(tmp_path / "twice.csv", posed) == read_points(tmp_path / "once.csv", posed)


def test_points_of_a_frame_that_the_map_lacks_are_counted_as_unseen(
    posed: PosedRun, tmp_path: Path
) -> None:
    without = replace(posed, frames=posed.frames[1:], T_map_camera=posed.T_map_camera[1:])
    (tmp_path / "a.csv").write_text(f"{HEAD}{posed.frames[0].name}.png,2,3,a\nf1.png,2,30,b\n")
    first, second = read_points(tmp_path / "a.csv", without)
    assert np.isnan(first.x_m) and np.isfinite(second.x_m)


def test_cover_is_counted_by_label_and_written(fused: Path, tmp_path: Path) -> None:
    with rasterio.open(fused / "map/orthomosaic.tif") as mosaic:
        row, column = mosaic.height // 2, mosaic.width // 2
    labels = enumerate(("Sand", "CCA", "Sand", "Sand"), column)
    text = "".join(f"0_0.png,{row},{place},{label}\n" for place, label in labels)
    (tmp_path / "annotations.csv").write_text("Name,Row,Column,Label code\n" + text)
    result = metrics(fused, folder=tmp_path / "to", points=tmp_path / "annotations.csv")
    assert [(each.label, each.points, each.fraction) for each in result.point_cover] == [
        ("Sand", 3, 0.75),
        ("CCA", 1, 0.25),
    ]
    table = (tmp_path / "to/point_cover.csv").read_text().splitlines()
    assert table[0] == "label,points,fraction,low,high" and len(table) == 3
    assert "gaps of the map" not in metrics_text(result)
    assert "off or in gaps of the map: 3" in metrics_text(replace(result, unseen_points=3))


def test_points_count_where_the_map_shows_the_bottom() -> None:
    heights = np.zeros((3, 4), np.float32)
    heights[1, 2] = np.nan
    grid = Grid(0.0, 3.0, 1.0, (3, 4))
    spots = [(0.5, 2.5), (2.5, 1.5), (3.5, 0.5), (4.5, 0.5), (0.5, -0.5), (np.nan, np.nan)]
    points = [LabelledPoint(f"{number}", *spot) for number, spot in enumerate(spots)]
    assert [each.label for each in on_map(points, heights, grid)] == ["0", "2"]


def test_the_interval_is_wilsons() -> None:
    """4 of 5, from his paper's formula worked by hand; and none of n, of closed form."""
    np.testing.assert_allclose(wilson(4, 5), (0.3755, 0.9638), atol=1e-4)
    np.testing.assert_allclose(wilson(0, 10), (0, 1.959964**2 / (10 + 1.959964**2)))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("Name,Row,Column\n", r"has no column 'label'"),
        (HEAD, "contains no labeled point"),
        (HEAD + "reef.png,1,1,a\n", r"line 2: 'reef.png' is neither a frame of the run nor a tile"),
        (HEAD + "f1.png,1,100000,a\n", r"line 2: 'f1.png' has \d+ x \d+ pixels, not one in row 1"),
        (HEAD + "f1.png,1.5,2,a\n", r"line 2: Row and Column are not whole numbers"),
        ("Name,Row,Column,Label,Row\nf1.png,1,2,a,9\n", r"has 2 columns 'row': leave one"),
        (
            HEAD + "f1.png,1,2,a\nf1.png,1,2,b\n",
            r"line 3: labels a point as 'b' that is 'a' in a line above",
        ),
    ],
)
def test_what_cannot_be_used_is_named(
    posed: PosedRun, tmp_path: Path, text: str, message: str
) -> None:
    (tmp_path / "a.csv").write_text(text)
    with pytest.raises(InputError, match=message):
        read_points(tmp_path / "a.csv", posed)
