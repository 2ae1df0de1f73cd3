"""A fused run in other programs' formats, read back by those programs or their libraries."""

import csv
import json
import shutil
import subprocess
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml
from mapping_scene import PAIR, flat_frames, track, write_map
from scipy.spatial.transform import Rotation

from stereo_seecolor.config import MountConfig
from stereo_seecolor.earth import (
    degrees_from_north_east,
    geodetic_from_geocentric,
    north_east_from_degrees,
)
from stereo_seecolor.errors import InputError, OutputError
from stereo_seecolor.extras.export import copc_file, mosaic_tiles, stac
from stereo_seecolor.extras.export.command import export, export_formats
from stereo_seecolor.extras.reef.measure import measure
from stereo_seecolor.extras.reef.metrics import metrics
from stereo_seecolor.extras.reef.outline_files import read_outlines
from stereo_seecolor.extras.reef.reef_texts import metrics_text
from stereo_seecolor.extras.streams import recording
from stereo_seecolor.extras.streams.mcap_recording import TOPICS
from stereo_seecolor.files.ply import read_triangles, read_vertices
from stereo_seecolor.inputs.trajectories import read_trajectory
from stereo_seecolor.records import GeoOrigin
from stereo_seecolor.run_folder.finished_run import open_run
from stereo_seecolor.run_folder.posed_run import open_posed_run

FRAMES = 5


@pytest.fixture(scope="module")
def fused(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A flat bottom at z = 0, seen from 1.5 m."""
    return write_map(tmp_path_factory.mktemp("run") / "out", flat_frames(FRAMES))


@pytest.mark.slow
@pytest.mark.parametrize("format", export_formats())
def test_the_run_is_left_as_it_is(fused: Path, tmp_path: Path, format: str) -> None:
    before = {path: path.stat().st_mtime_ns for path in fused.rglob("*")}
    result = export(fused, format, tmp_path / "to")
    assert {path: path.stat().st_mtime_ns for path in fused.rglob("*")} == before
    assert (result.frames, result.folder) == (FRAMES, tmp_path / "to")
    assert result.bytes == sum(
        path.stat().st_size for path in (tmp_path / "to").rglob("*") if path.is_file()
    )
    assert sorted(path.name for path in tmp_path.iterdir()) == ["to"]


def test_names_of_frames_are_in_any_language(fused: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    shutil.copytree(fused, out)
    track = out / "map" / "trajectory.tum"
    track.write_text(track.read_text(encoding="utf-8") + "# récif\n", encoding="utf-8")
    assert len(open_posed_run(out).frames) == FRAMES


def test_a_colmap_model_of_names_with_spaces_is_only_binary(tmp_path: Path) -> None:
    import pycolmap

    frames = [replace(frame, name=f"dive {i}") for i, frame in enumerate(flat_frames(2))]
    note = export(write_map(tmp_path / "out", frames), "colmap", tmp_path / "to").note
    assert "names of these images hold spaces" in note
    model = pycolmap.Reconstruction(tmp_path / "to" / "sparse" / "0")
    assert {image.name for image in model.images.values()} == {"dive 0.png", "dive 1.png"}
    assert not list((tmp_path / "to" / "sparse" / "0").glob("*.txt"))


@pytest.mark.slow
def test_colmap_reads_the_model(fused: Path, tmp_path: Path) -> None:
    import pycolmap

    export(fused, "colmap", tmp_path / "to")
    for suffix in ("txt", "bin"):
        (tmp_path / suffix).mkdir()
        for part in (tmp_path / "to" / "sparse" / "0").glob(f"*.{suffix}"):
            shutil.copy(part, tmp_path / suffix)
    model, binary = (pycolmap.Reconstruction(tmp_path / suffix) for suffix in ("txt", "bin"))
    assert binary.compute_num_observations() == model.compute_num_observations() > 0
    for number, point in list(model.points3D.items())[::100]:
        other = binary.points3D[number]
        np.testing.assert_allclose(other.xyz, point.xyz, rtol=1e-8)
        assert (other.color == point.color).all() and len(other.track.elements) == len(
            point.track.elements
        )
    for number, image in model.images.items():
        assert binary.images[number].name == image.name
        np.testing.assert_allclose(
            binary.images[number].projection_center(), image.projection_center(), atol=1e-7
        )
    assert (model.num_images(), model.num_cameras()) == (FRAMES, 1)
    assert model.compute_mean_track_length() > 2
    (camera,) = model.cameras.values()
    assert camera.params.tolist() == [
        PAIR.focal_px,
        PAIR.focal_px,
        PAIR.cx_left_px + 0.5,
        PAIR.cy_px + 0.5,
    ]
    truth = track(FRAMES)
    for image in model.images.values():
        number = truth.names.index(Path(image.name).stem)
        np.testing.assert_allclose(
            image.projection_center(), truth.T_world_camera[number, :3, 3], atol=1e-6
        )
        seen = [point for point in image.points2D if point.has_point3D()]
        assert len(seen) > 500
        for point in seen[::50]:
            position = model.points3D[point.point3D_id]
            np.testing.assert_allclose(image.project_point(position.xyz), point.xy, atol=0.01)
            assert abs(position.xyz[2]) < 0.02
            np.testing.assert_allclose(position.color, (200, 120, 40), atol=2)


@pytest.mark.skipif(
    not shutil.which("colmap"), reason="COLMAP is not installed (Debian: apt-get install colmap)"
)
def test_the_colmap_program_analyzes_the_model(fused: Path, tmp_path: Path) -> None:
    export(fused, "colmap", tmp_path / "to")
    command = ["colmap", "model_analyzer", "--path", str(tmp_path / "to" / "sparse" / "0")]
    said = subprocess.run(command, capture_output=True, text=True, check=True)
    assert f"Registered images: {FRAMES}" in said.stdout + said.stderr


def test_nerfstudios_depth_maps_and_poses_give_the_bottom(fused: Path, tmp_path: Path) -> None:
    export(fused, "nerfstudio", tmp_path / "to")
    content = json.loads((tmp_path / "to" / "transforms.json").read_text())
    for frame in content["frames"]:
        image = cv2.imread(str(tmp_path / "to" / frame["file_path"]))
        depth_mm = cv2.imread(str(tmp_path / "to" / frame["depth_file_path"]), cv2.IMREAD_UNCHANGED)
        depth_m = depth_mm * content["depth_unit_scale_factor"]
        assert image.shape[:2] == depth_m.shape == (content["h"], content["w"])
        row, column = 20, 100
        x = (column + 0.5 - content["cx"]) / content["fl_x"]
        y = (row + 0.5 - content["cy"]) / content["fl_y"]
        point = np.array([x, -y, -1, 1 / depth_m[row, column]]) * depth_m[row, column]
        assert (np.array(frame["transform_matrix"]) @ point)[2] == pytest.approx(0, abs=0.005)
    assert (tmp_path / "to" / content["ply_file_path"]).is_file()


def test_metashapes_cameras_are_the_tracks_poses(fused: Path, tmp_path: Path) -> None:
    export(fused, "metashape", tmp_path / "to")
    again = read_trajectory(tmp_path / "to" / "cameras.xml", MountConfig())
    truth = track(FRAMES)
    assert again.names == truth.names
    np.testing.assert_allclose(again.T_world_camera, truth.T_world_camera, atol=1e-6)
    assert sorted(path.stem for path in (tmp_path / "to" / "images").iterdir()) == sorted(
        truth.names
    )


def test_kwivers_cameras_project_the_map_to_where_the_frames_saw_it(
    fused: Path, tmp_path: Path
) -> None:
    export(fused, "kwiver", tmp_path / "to")
    truth = track(FRAMES)
    for number, image in enumerate((tmp_path / "to" / "image_list.txt").read_text().splitlines()):
        assert (tmp_path / "to" / image).is_file()
        parts = (tmp_path / "to" / "krtd" / f"{Path(image).stem}.krtd").read_text().split("\n\n")
        K, R, t, distortion = (
            np.array([row.split() for row in part.strip().split("\n")], float) for part in parts
        )
        np.testing.assert_allclose(K, PAIR.P_left)
        np.testing.assert_allclose(-R.T @ t[0], truth.T_world_camera[number, :3, 3], atol=1e-6)
        assert R[2, 2] == pytest.approx(-1, abs=1e-6) and distortion.tolist() == [[0]]
    assert len(read_vertices(tmp_path / "to" / "cloud.ply")) > 100


@pytest.mark.slow
def test_the_glb_is_the_mesh(fused: Path, tmp_path: Path) -> None:
    import trimesh

    export(fused, "glb", tmp_path / "to")
    scene = trimesh.load(tmp_path / "to" / "mesh.glb")
    (mesh,) = scene.geometry.values()
    vertices = read_vertices(fused / "map" / "mesh.ply")
    assert len(mesh.faces) == len(read_triangles(fused / "map" / "mesh.ply")) > 100
    np.testing.assert_allclose(mesh.vertices, vertices["position"], atol=1e-6)
    low, high = scene.bounds
    assert high[1] - low[1] < 0.1 < high[2] - low[2], "y is up, and the bottom is flat"


def test_tiles_put_together_are_the_mosaic(
    fused: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import rasterio

    monkeypatch.setattr(mosaic_tiles, "MOST_PX", 30)
    export(fused, "tiles", tmp_path / "to")
    with rasterio.open(fused / "map" / "orthomosaic.tif") as mosaic:
        pixels, transform = mosaic.read(), mosaic.transform
    with (tmp_path / "to" / "tiles.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) > 3
    for row in rows:
        tile = cv2.cvtColor(
            cv2.imread(str(tmp_path / "to" / "tiles" / row["name"])), cv2.COLOR_BGR2RGB
        )
        assert max(tile.shape[:2]) <= 30
        left, top = (
            round(value) for value in ~transform @ (float(row["west_m"]), float(row["north_m"]))
        )
        part = np.moveaxis(
            pixels[:3, top : top + tile.shape[0], left : left + tile.shape[1]], 0, -1
        )
        np.testing.assert_array_equal(tile, part)
        assert float(row["meters_per_pixel"]) == pytest.approx(0.02)


def test_ifdo_is_valid(fused: Path, tmp_path: Path) -> None:
    import ifdo

    export(fused, "ifdo", tmp_path / "to")
    read = ifdo.iFDO.load(tmp_path / "to" / "image-set.ifdo.yaml")
    assert set(read.image_set_items) == {
        path.name for path in (tmp_path / "to" / "images").iterdir()
    }
    for item in read.image_set_items.values():
        assert item.image_meters_above_ground == pytest.approx(1.5, abs=0.01)
        assert item.image_datetime is None, "a counter is no date"
        assert item.image_latitude is None


def test_ifdo_of_a_map_on_earth_has_positions(fused: Path, tmp_path: Path) -> None:
    import ifdo

    out = on_earth(fused, tmp_path / "out")
    export(out, "ifdo", tmp_path / "to")
    items = ifdo.iFDO.load(tmp_path / "to" / "image-set.ifdo.yaml").image_set_items
    origin = GeoOrigin(-23.5, 152.0)
    for i in range(FRAMES):
        item = items[f"f{i}.png"]
        north, east = north_east_from_degrees(item.image_latitude, item.image_longitude, origin)
        np.testing.assert_allclose(
            (north, east, item.image_altitude_meters), (0, 0.3 * i, 1.5), atol=1e-6
        )


def on_earth(fused: Path, out: Path) -> Path:
    """A copy of the run whose map knows its place."""
    shutil.copytree(fused, out)
    description = json.loads((out / "map" / "map.json").read_text())
    description["origin"] = {"latitude_deg": -23.5, "longitude_deg": 152.0}
    (out / "map" / "map.json").write_text(json.dumps(description))
    return out


@pytest.fixture
def without_depths(fused: Path, tmp_path: Path) -> Path:
    """The run, whose map knows its place on Earth, but no depth."""
    out = on_earth(fused, tmp_path / "out")
    description = json.loads((out / "map/map.json").read_text())
    description["origin"]["depth_known"] = False
    (out / "map/map.json").write_text(json.dumps(description))
    return out


def test_an_unknown_depth_is_not_exported_as_an_altitude(
    without_depths: Path, tmp_path: Path
) -> None:
    out = without_depths
    export(out, "biigle", tmp_path / "biigle")
    export(out, "ifdo", tmp_path / "ifdo")
    rows = csv.DictReader((tmp_path / "biigle/metadata.csv").read_text().splitlines())
    assert all(row["lat"] and not row["gps_altitude"] for row in rows)
    items = yaml.safe_load((tmp_path / "ifdo/image-set.ifdo.yaml").read_text())["image-set-items"]
    assert all("image-latitude" in item for item in items.values())
    assert not any("image-altitude-meters" in item for item in items.values())


@pytest.mark.slow
def test_tiles_for_globes_lie_where_the_map_lies(fused: Path, tmp_path: Path) -> None:
    import trimesh

    export(on_earth(fused, tmp_path / "out"), "3d-tiles", tmp_path / "to")
    root = json.loads((tmp_path / "to" / "tileset.json").read_text())["root"]
    turned = np.asarray(
        trimesh.load(tmp_path / "to" / root["content"]["uri"], force="mesh").vertices
    )
    points = turned @ np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]]).T  # y up to z up, as viewers do
    box = np.array(root["boundingVolume"]["box"])
    assert (np.abs(points - box[:3]) <= np.diag(box[3:].reshape(3, 3)) + 1e-6).all()
    T = np.array(root["transform"]).reshape(4, 4).T
    posed = open_posed_run(tmp_path / "out")
    for local in (points[0], points[-1]):
        latitude, longitude, height = geodetic_from_geocentric((T @ [*local, 1])[:3])
        world = local + posed.offset_m
        north_east = north_east_from_degrees(latitude, longitude, GeoOrigin(-23.5, 152.0))
        np.testing.assert_allclose([*north_east, height], [world[1], world[0], world[2]], atol=1e-3)


@pytest.mark.slow
def test_tiles_of_unknown_depth_say_so(without_depths: Path, tmp_path: Path) -> None:
    note = export(without_depths, "3d-tiles", tmp_path / "to").note
    assert "; the depths are unknown, so that the map lies near the water surface" in note


@pytest.mark.slow
def test_a_map_of_no_known_place_has_tiles_in_its_world(fused: Path, tmp_path: Path) -> None:
    assert "depths" not in export(fused, "3d-tiles", tmp_path / "to").note
    root = json.loads((tmp_path / "to" / "tileset.json").read_text())["root"]
    assert root["transform"][12:15] == pytest.approx(open_posed_run(fused).offset_m.tolist())


def test_pystac_reads_the_catalog(fused: Path, tmp_path: Path) -> None:
    import pystac

    export(on_earth(fused, tmp_path / "out"), "stac", tmp_path / "to")
    (item,) = pystac.Collection.from_file(str(tmp_path / "to" / "collection.json")).get_items()
    assert item.id == "out" and item.bbox == pytest.approx([152.0, -23.5, 152.0, -23.5], abs=1e-4)
    assert all((tmp_path / "to" / asset.href).is_file() for asset in item.assets.values())
    assert "map/dem.tif" in item.assets and item.common_metadata.start_datetime is not None


def test_a_catalog_says_of_frames_without_a_date_that_its_times_are_others(
    fused: Path, tmp_path: Path
) -> None:
    export(fused, "stac", tmp_path / "to")
    item = json.loads((tmp_path / "to" / f"{fused.name}.json").read_text())
    assert item["properties"]["stereo-seecolor:undated"] is True
    assert "the times are those of processing" in item["properties"]["description"]
    whole = json.loads((tmp_path / "to" / "collection.json").read_text())
    assert whole["extent"]["temporal"]["interval"] == [[None, None]]
    assert whole["description"] == "1 dive of a stereo camera"


def test_the_item_of_a_run_named_collection_stays_beside_the_collection(
    fused: Path, tmp_path: Path
) -> None:
    shutil.copytree(fused, tmp_path / "Collection")
    export(tmp_path / "Collection", "stac", tmp_path / "to")
    files = {path.name.casefold() for path in (tmp_path / "to").iterdir()}
    assert files == {"collection.json", "collection_item.json"}
    (link,) = json.loads((tmp_path / "to/collection.json").read_text())["links"]
    assert json.loads((tmp_path / "to" / link["href"]).read_text())["id"] == "Collection"


def at_the_antimeridian(fused: Path, out: Path) -> Path:
    """A copy of the run whose track lies on both sides of the antimeridian."""
    on_earth(fused, out)
    track = open_posed_run(out).map.track
    middle_m = (min(point.x_m for point in track) + max(point.x_m for point in track)) / 2
    description = json.loads((out / "map" / "map.json").read_text())
    start = degrees_from_north_east(0.0, -middle_m, GeoOrigin(-17.5, 180.0))
    description["origin"] = {"latitude_deg": -17.5, "longitude_deg": start[1] % 360}
    (out / "map" / "map.json").write_text(json.dumps(description))
    return out


def test_longitudes_end_at_the_antimeridian(fused: Path, tmp_path: Path) -> None:
    out = at_the_antimeridian(fused, tmp_path / "out")
    export(out, "biigle", tmp_path / "biigle")
    export(out, "ifdo", tmp_path / "ifdo")
    rows = csv.DictReader((tmp_path / "biigle" / "metadata.csv").read_text().splitlines())
    document = yaml.safe_load((tmp_path / "ifdo" / "image-set.ifdo.yaml").read_text())
    for longitudes in (
        [float(row["lng"]) for row in rows],
        [item["image-longitude"] for item in document["image-set-items"].values()],
    ):
        assert min(longitudes) < -179.9999 and max(longitudes) > 179.9999
        assert all(-180 <= longitude <= 180 for longitude in longitudes)


def test_a_catalog_box_crosses_the_antimeridian(fused: Path, tmp_path: Path) -> None:
    export(at_the_antimeridian(fused, tmp_path / "out"), "stac", tmp_path / "to")
    item = json.loads((tmp_path / "to" / "out.json").read_text())
    whole = json.loads((tmp_path / "to" / "collection.json").read_text())
    (box,) = whole["extent"]["spatial"]["bbox"]
    west, south, east, north = item["bbox"]
    assert 179.9999 < west < 180 and -180 < east < -179.9999 and south <= north
    assert box == pytest.approx(item["bbox"], abs=1e-9)
    halves = item["geometry"]["coordinates"]
    assert item["geometry"]["type"] == "MultiPolygon" and len(halves) == 2
    for (ring,), ends in zip(halves, [(west, 180.0), (-180.0, east)], strict=True):
        assert {place[0] for place in ring} == set(ends)


def test_the_box_around_dives_is_the_smallest() -> None:
    def box(*boxes: list[float]) -> object:
        times = {"start_datetime": "2026-01-01", "end_datetime": "2026-01-02"}
        items = [{"id": f"{i}", "bbox": one, "properties": times} for i, one in enumerate(boxes)]
        return stac.collection(items, "dives")["extent"]["spatial"]["bbox"][0]

    assert box([170, 0, 171, 1], [-171, -2, -170, 0]) == [170, -2, -170, 1]
    assert box([179, 0, -179, 1], [170, 0, 171, 1]) == [170, 0, -179, 1]
    assert box([10, 0, 11, 1], [-20, 5, -19, 6]) == [-20, 0, 11, 6]


@pytest.mark.parametrize("latitude_deg", [-60.0, 0.0, 23.0, 75.0])
def test_degrees_are_the_inverse_of_meters(latitude_deg: float) -> None:
    origin = GeoOrigin(latitude_deg, 179.999)
    latitude, longitude = degrees_from_north_east(-800.0, 2500.0, origin)
    np.testing.assert_allclose(
        north_east_from_degrees(latitude, longitude, origin), (-800.0, 2500.0), atol=1e-5
    )


def test_sixteen_bits_become_eight(fused: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    shutil.copytree(fused, out)
    file = out / "corrected" / "f0.png"
    cv2.imwrite(str(file), cv2.imread(str(file)).astype(np.uint16) * 257)
    export(out, "metashape", tmp_path / "to")
    exported = cv2.imread(str(tmp_path / "to" / "images" / "f0.png"), cv2.IMREAD_UNCHANGED)
    np.testing.assert_array_equal(exported, cv2.imread(str(fused / "corrected" / "f0.png")))


@pytest.mark.slow
def test_frames_that_are_not_in_the_main_part_are_counted(fused: Path, tmp_path: Path) -> None:
    out = shutil.copytree(fused, tmp_path / "run")
    frames = len(open_run(out).frames)
    for name in ("trajectory.tum", "poses.csv"):
        path = out / "map" / name
        path.write_text("".join(path.read_text().splitlines(keepends=True)[:-1]))
    said = f"1 of {frames} frames are in other parts of the map, or in none"
    assert said in export(out, "ifdo", tmp_path / "export").note
    assert said in metrics_text(metrics(out))
    assert not export(fused, "ifdo", tmp_path / "whole").note


def test_nothing_is_written_over(fused: Path, tmp_path: Path) -> None:
    (tmp_path / "mine.txt").write_text("mine")
    with pytest.raises(OutputError, match="already exists: give a new or an empty folder"):
        export(fused, "glb", tmp_path)
    with pytest.raises(OutputError, match="already exists"):
        export(fused, "glb", tmp_path / "mine.txt")
    assert [path.name for path in tmp_path.iterdir()] == ["mine.txt"]
    (tmp_path / "empty").mkdir()
    assert export(fused, "glb", tmp_path / "empty").files == 1


@pytest.mark.slow
def test_an_export_that_fails_leaves_nothing(fused: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    shutil.copytree(fused, out)
    (out / "corrected" / "f3.png").write_bytes(b"x")
    for format in ("colmap", "textured-glb"):
        with pytest.raises(InputError, match=r"f3\.png: is missing or damaged"):
            export(out, format, tmp_path / "to")
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


@pytest.mark.parametrize(
    ("name", "hint"),
    [
        ("coralnet", "for coralnet use --to tiles$"),
        ("QGIS", "map/orthomosaic.tif and map/dem.tif of OUT are GeoTIFFs.*; for QGIS use --to "),
        ("geotiff", "GeoTIFFs; open them directly$"),
        ("a", "one of 3d-tiles, biigle"),
    ],
)
def test_a_program_without_a_format_of_its_name_gets_a_hint(
    fused: Path, tmp_path: Path, name: str, hint: str
) -> None:
    with pytest.raises(InputError, match=f"--to {name}: is not a known format: .*{hint}"):
        export(fused, name, tmp_path / "to")


def test_what_cannot_be_exported(fused: Path, tmp_path: Path) -> None:
    with pytest.raises(
        InputError, match="--to gaussian: is not a known format: one of 3d-tiles, biigle, "
    ):
        export(fused, "gaussian", tmp_path / "to")
    out = tmp_path / "out"
    shutil.copytree(fused, out)
    (out / "map" / "trajectory.tum").write_text("nonsense\n")
    with pytest.raises(InputError, match="map: is damaged"):
        open_posed_run(out)
    shutil.rmtree(out / "map")
    with pytest.raises(InputError, match=r"holds no map with .* make it with stereo-seecolor fuse"):
        open_posed_run(out)


def test_the_command_line(
    fused: Path, tmp_path: Path, cli: Callable[..., tuple[int, str, str]]
) -> None:
    code, said, _ = cli("export", "--list")
    assert code == 0
    assert all(name in said for name in export_formats())
    code, said, _ = cli(
        "export", str(fused), "--to", "glb", "--out", str(tmp_path / "to"), "--json"
    )
    assert (code, json.loads(said)["files"]) == (0, 1)
    code, _, error = cli("export", str(fused))
    assert code == 2
    assert "give OUT, --to FORMAT and --out FOLDER, or --list" in error


def test_an_mcap_is_read_by_rosbags_and_by_the_library_of_the_format(
    fused: Path, tmp_path: Path
) -> None:
    from mcap.reader import make_reader
    from mcap_ros2.decoder import DecoderFactory
    from rosbags.rosbag2 import Reader
    from rosbags.typesys import Stores, get_typestore

    export(fused, "mcap", tmp_path / "to")
    file, posed, store = (
        tmp_path / "to/dive.mcap",
        open_posed_run(fused),
        get_typestore(Stores.ROS2_HUMBLE),
    )
    with Reader(file) as reader:
        assert {topic: info.msgcount for topic, info in reader.topics.items()} == dict.fromkeys(
            TOPICS, FRAMES
        )
        decoded = [
            (c.topic, time_ns, store.deserialize_cdr(data, c.msgtype))
            for c, time_ns, data in reader.messages(reader.connections)
        ]
    with file.open("rb") as opened:
        library = make_reader(opened, decoder_factories=[DecoderFactory()])
        by_library = {
            (channel.topic, m.log_time): ros
            for _, channel, m, ros in library.iter_decoded_messages()
        }
    assert len(by_library) == len(decoded) == FRAMES * len(TOPICS)
    frame, T = posed.frames[1], posed.T_map_camera[1]
    stamp_ns = recording.stamp_of(frame.name, frame.timestamp_s, 1)
    found = {topic: message for topic, time_ns, message in decoded if time_ns == stamp_ns}
    image = found["/stereo/left/image_rect_color/compressed"]
    assert bytes(image.data) == frame.products["corrected"].read_bytes()
    range_m = (
        found["/stereo/range/image_rect"].data.view("<f4").reshape(frame.measured_range_m().shape)
    )
    np.testing.assert_array_equal(range_m, frame.measured_range_m())
    pose = found["/tf"].transforms[0].transform
    q = pose.rotation
    np.testing.assert_allclose(
        (pose.translation.x, pose.translation.y, pose.translation.z), T[:3, 3]
    )
    np.testing.assert_allclose(
        Rotation.from_quat([q.x, q.y, q.z, q.w]).as_matrix(), T[:3, :3], atol=1e-12
    )
    cloud = found["/stereo/points2"]
    values = cloud.data.reshape(-1, 16)
    xyz_m = values[:, :12].copy().view("<f4") @ T[:3, :3].T + T[:3, 3]
    assert len(values) == cloud.width > 500
    assert np.abs(xyz_m[:, 2]).max() < 0.02  # the flat bottom
    np.testing.assert_allclose(values[:, [14, 13, 12]].mean(0), (200, 120, 40), atol=3)
    np.testing.assert_array_equal(found["/stereo/left/camera_info"].k.reshape(3, 3), PAIR.P_left)
    assert bytes(by_library["/stereo/range/image_rect", stamp_ns].data) == range_m.tobytes()
    right = found["/stereo/right/camera_info"].p.reshape(3, 4)
    np.testing.assert_allclose(right[:, 3], (-PAIR.focal_px * PAIR.baseline_m, 0, 0))
    disparity = found["/stereo/disparity"]
    values = disparity.image.data.view("<f4").reshape(range_m.shape)
    known = np.isfinite(range_m)
    np.testing.assert_array_equal(values < disparity.min_disparity, ~known)
    depth_m = disparity.f * disparity.t / values[known]
    np.testing.assert_allclose(depth_m, PAIR.depth_from_range(range_m)[known], rtol=1e-5)
    assert disparity.max_disparity == pytest.approx(values.max())


def test_stamps_of_bags_come_back_to_the_nanosecond() -> None:
    def stamp(name: str, timestamp_s: float | None) -> int:
        return recording.stamp_of(name, timestamp_s, 4)

    assert stamp("1700000000-123456789", 1700000000.1234567) == 1_700_000_000_123_456_789
    assert (stamp("a", 12.5), stamp("a", None)) == (12_500_000_000, 5_000_000_000)


@pytest.mark.slow
def test_a_run_is_recorded_with_or_without_a_map(make_dive, cli, tmp_path: Path) -> None:
    from rosbags.rosbag2 import Reader

    dive = make_dive(2)
    sides = (
        "--left",
        dive.root / "L",
        "--right",
        dive.root / "R",
        "--calib",
        dive.root / "cam.yaml",
    )
    words = ("run", *sides, "--out", tmp_path / "out")
    code, printed, said = cli(*words, "--out-mcap", tmp_path / "a/dive.mcap")
    assert code == 0, said
    assert "dive.mcap: 2 frames as ROS 2 messages" in printed
    with Reader(tmp_path / "a/dive.mcap") as reader:
        counts = {topic: info.msgcount for topic, info in reader.topics.items()}
    assert counts == {topic: 2 * (topic != "/tf") for topic in TOPICS}
    code, _, said = cli(*words, "--out-mcap", tmp_path / "a/dive.mcap")
    assert (code, "already exists: give --overwrite" in said) == (1, True)


def test_a_taglab_project_has_colors_and_heights_of_one_size(fused: Path, tmp_path: Path) -> None:
    import rasterio

    export(fused, "taglab", tmp_path / "to")
    project = json.loads((tmp_path / "to/project.json").read_text())
    (image,) = project["images"]
    with (
        rasterio.open(tmp_path / "to/rgb.tif") as rgb,
        rasterio.open(tmp_path / "to/dem.tif") as dem,
    ):
        assert (
            (rgb.width, rgb.height) == (dem.width, dem.height) == (image["width"], image["height"])
        )
        assert (rgb.count, rgb.transform, dem.nodata) == (3, dem.transform, -9999)
        heights = dem.read(1)
        assert float(image["map_px_to_mm_factor"]) == pytest.approx(1000 * rgb.res[0])
    assert np.isfinite(heights).all()
    assert np.abs(heights[heights > -9999]).max() < 0.01 and (heights > -9999).mean() > 0.5
    assert [(each["filename"], each["type"]) for each in image["channels"]] == [
        ("rgb.tif", "RGB"),
        ("dem.tif", "DEM"),
    ]
    assert len(image["acquisition_date"]) == 10
    corner = [[10, 10], [40, 10], [40, 40], [10, 40]]
    image["annotations"]["regions"] = [
        {"id": 1, "class name": "coral", "contour": corner, "inner contours": []}
    ]
    (tmp_path / "drawn.json").write_text(json.dumps(project))
    (outline,) = read_outlines(tmp_path / "drawn.json", open_posed_run(fused))
    assert np.ptp(outline.rings[0], axis=0) == pytest.approx([0.6, 0.6])


def test_results_of_a_run_with_wrong_ranges_say_so(fused: Path, tmp_path: Path, cli) -> None:
    shutil.copytree(fused, tmp_path / "out")
    points = tmp_path / "points.csv"
    points.write_text("measure,frame,kind,label,x_m,y_m\n1,,point,,0,0\n")

    def codes() -> list[tuple[int, bool]]:
        commands = [
            ("metrics", tmp_path / "out"),
            ("measure", tmp_path / "out", points),
            ("export", tmp_path / "out", "--to", "biigle", "--out", tmp_path / "to"),
        ]
        found = [cli(*words) for words in commands]
        shutil.rmtree(tmp_path / "to")
        return [(code, "ranges are wrong: calibration: a yaw\n" in said) for code, _, said in found]

    assert codes() == [(0, False)] * 3
    run = json.loads((tmp_path / "out/run.json").read_text())
    run["totals"] |= {"ranges_are_wrong": True, "notes": ["else", "calibration: a yaw"]}
    (tmp_path / "out/run.json").write_text(json.dumps(run))
    assert codes() == [(3, True)] * 3


def test_heights_of_a_map_deep_in_the_sea_keep_their_base(fused: Path, tmp_path: Path) -> None:
    import rasterio

    shutil.copytree(fused, tmp_path / "deep")
    with rasterio.open(tmp_path / "deep/map/dem.tif", "r+") as terrain:
        terrain.offsets = [-1500.0, *terrain.offsets[1:]]
    export(tmp_path / "deep", "taglab", tmp_path / "to")
    with rasterio.open(tmp_path / "to/dem.tif") as terrain:
        assert terrain.offsets == (-1500,)
    (tmp_path / "points.csv").write_text(
        "measure,frame,kind,label,x_m,y_m,z_m\n1,,point,,0,0,\n2,,point,,0,0,-1500\n"
    )
    alone, given = measure(tmp_path / "deep", tmp_path / "points.csv")
    assert alone.value == alone.z_m == pytest.approx(-1500, abs=0.01)
    assert (given.value, given.std) == (-1500, pytest.approx(alone.std, rel=0.1))


def test_biigle_gets_a_row_for_each_image(fused: Path, tmp_path: Path) -> None:
    export(fused, "biigle", tmp_path / "to")
    with (tmp_path / "to/metadata.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert {row["filename"] for row in rows} == {
        path.name for path in (tmp_path / "to/images").iterdir()
    }
    assert float(rows[0]["distance_to_ground"]) == pytest.approx(1.5, abs=0.01)
    assert float(rows[0]["area"]) == pytest.approx(160 * 128 * (1.5 / 200) ** 2, rel=0.01)
    assert (rows[0]["taken_at"], rows[0]["lat"]) == ("", "")


@pytest.mark.slow
def test_laspy_reads_the_cloud_level_by_level(
    fused: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import laspy

    monkeypatch.setattr(copc_file, "FEW", 300)
    monkeypatch.setattr(copc_file, "GRID", 8)
    out = on_earth(fused, tmp_path / "out")
    result = export(out, "copc", tmp_path / "to")
    posed, cloud = open_posed_run(out), read_vertices(fused / "map" / "cloud.ply")
    with laspy.CopcReader.open(tmp_path / "to" / "cloud.copc.laz") as file:
        whole, coarse = file.query(), file.query(level=0)
        box = laspy.copc.Bounds(mins=np.array([0.2, -0.2]), maxs=np.array([0.5, 0.2]))
        part = file.query(box)
    with laspy.open(tmp_path / "to" / "cloud.copc.laz") as file:
        assert (
            file.header.parse_crs().to_authority() is None
            and "Transverse_Mercator" in file.header.parse_crs().to_wkt("WKT1_GDAL")
        )
    assert 20 < len(coarse) < len(whole) / 10
    assert (
        result.note == f"{len(cloud):,} points in {result.note.split()[-2]} nodes"
        and int(result.note.split()[-2]) > 5
    )
    found = np.stack(
        [whole.x, whole.y, whole.z, whole.red // 257, whole.green // 257, whole.blue // 257], axis=1
    )
    wanted = np.concatenate([cloud["position"] + posed.offset_m, cloud["color"]], axis=1)
    found, wanted = (rows[np.lexsort(np.round(rows[:, :3], 3).T)] for rows in (found, wanted))
    np.testing.assert_allclose(np.sort(found, axis=0), np.sort(wanted, axis=0), atol=6e-5)
    inside = ((wanted[:, :2] >= (0.2, -0.2)) & (wanted[:, :2] <= (0.5, 0.2))).all(axis=1)
    assert abs(len(part) - inside.sum()) < 0.01 * len(wanted)


def test_every_point_of_an_octree_is_in_one_node_that_holds_it() -> None:
    points = np.random.default_rng(0).random((60_000, 3)) ** 3
    seen = np.zeros(len(points), int)
    for level, cell, chosen in copc_file.octree(points, 1.0):
        seen[chosen] += 1
        assert (np.floor(points[chosen] * 2**level) == cell).all()
    assert (seen == 1).all()
