"""The map as the page holds it: what is packed comes out again, tiles make up the whole, and it is
made once.
"""

import gc
import json
import tracemalloc
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from mapping_scene import CONFIG, PAIR, flat_frame, flat_frames, write_map
from page_scripts import bytes_of, colors_of, numbers_of, script_values

from stereo_seecolor.commands.fuse import fuse
from stereo_seecolor.commands.report import report
from stereo_seecolor.config import RunConfig
from stereo_seecolor.files.ply import header, read_triangles, read_vertices
from stereo_seecolor.mapping.surface.small_holes import boundary, closed
from stereo_seecolor.records import SurveyFrame
from stereo_seecolor.report.height_code import coded_heights
from stereo_seecolor.report.map_images import levels, pyramid
from stereo_seecolor.report.map_mesh import MeshSizes, Piece, rim_of
from stereo_seecolor.report.mesh_levels import Level, MeshSource, Numbered, cluster_vertices
from stereo_seecolor.report.mesh_levels import levels as made_levels
from stereo_seecolor.run_folder.layout import MESH


@pytest.fixture
def small_pieces(monkeypatch: pytest.MonkeyPatch) -> None:
    """Meshes of some thousand triangles have several levels of several pieces."""
    monkeypatch.setattr("stereo_seecolor.report.mesh_levels.SIZES", MeshSizes(300, 800))


def hills(count: int = 60, seed: int = 0) -> Piece:
    """A grid of triangles over hills, 1 cm apart, in no order; none of it is shaded as a rim."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[:count, :count] * 0.01
    points = (
        np.stack([x + 5, y - 3, 0.1 * np.sin(9 * x) * np.cos(7 * y)], axis=-1)
        .reshape(-1, 3)
        .astype(np.float32)
    )
    corner = (np.arange(count - 1)[:, None] * count + np.arange(count - 1)).ravel()
    triangles = np.concatenate(
        [corner[:, None] + [0, 1, count], corner[:, None] + [1, count + 1, count]]
    )
    order = rng.permutation(len(points))
    place = np.empty_like(order)
    place[order] = np.arange(len(order))
    colors = rng.integers(0, 256, (len(points), 3)).astype(np.uint8)
    inner = np.zeros(len(points), bool)
    return Piece(points[order], colors[order], rng.permutation(place[triangles]), inner)


def whole(points_m: np.ndarray, colors: np.ndarray, triangles: np.ndarray) -> Piece:
    """A piece that is all of a mesh."""
    return Piece(points_m, colors, triangles, rim_of(triangles, len(points_m)))


def mesh_levels(mesh: Piece, voxel_m: float, folder: Path) -> list[Level]:
    source = MeshSource.of(mesh.points_m, mesh.colors, mesh.triangles)
    return list(made_levels(source, voxel_m, folder))


def unpacked(packed: dict[str, Any]) -> Piece:
    """What the page's program makes of a packed piece."""
    points_m, triangles = surface_of(packed)
    return whole(points_m.astype(np.float32), colors_of(packed["colors"]), triangles)


def surface_of(packed: dict[str, Any]) -> tuple[np.ndarray, np.ndarray]:
    """Points (N, 3) in meters and triangles (T, 3)."""
    steps = numbers_of(packed["positions"]).reshape(3, -1).T
    triangles = numbers_of(packed["corners"]).reshape(-1, 3)
    return np.array(packed["low_m"]) + steps * packed["step_m"], triangles


def parts_of(path: Path) -> list[dict[str, Any]]:
    """The packed pieces of a script."""
    held = script_values(path)[1]
    return [
        {name: bytes_of(value) if type(value) is str else value for name, value in part.items()}
        for part in (held if type(held) is list else [held])
    ]


def as_set(piece: Piece, step_m: float) -> set[tuple[int, ...]]:
    """Triangles as the places and colors of their corners, in no order."""
    corners = np.concatenate([np.rint(piece.points_m / step_m), piece.colors], axis=1).astype(int)[
        piece.triangles
    ]
    return {tuple(int(v) for v in triangle.ravel()) for triangle in corners}


def test_what_is_packed_comes_out_again() -> None:
    mesh, step_m = hills(), 0.0005
    found = unpacked(mesh.packed(step_m))
    np.testing.assert_allclose(found.points_m, mesh.points_m, atol=step_m / 2 + 1e-5)
    np.testing.assert_array_equal(found.triangles, mesh.triangles)


def test_colors_are_a_step_of_two_off_at_most() -> None:
    mesh = hills()
    shown = unpacked(mesh.packed(0.001)).colors.astype(int)
    assert abs(shown - mesh.colors).max() <= 2


@pytest.mark.usefixtures("small_pieces")
def test_the_rim_of_a_mesh_is_dark_and_the_seams_of_its_tiles_are_not(tmp_path: Path) -> None:
    mesh = replace(hills(), colors=np.full((3600, 3), 200, np.uint8))
    at = np.rint(100 * (mesh.points_m[:, :2] - (5, -3))).astype(int)
    hole = np.flatnonzero((at == 30).all(axis=1))
    mesh = whole(
        mesh.points_m, mesh.colors, mesh.triangles[~np.isin(mesh.triangles, hole).any(axis=1)]
    )
    border = (at == 0).any(axis=1) | (at == 59).any(axis=1)
    x, y = (at - 30).T  # the two corners that no triangle joins to the hole's point stay apart
    beside = (np.abs(x) <= 1) & (np.abs(y) <= 1) & (x * y != 1) & ((x != 0) | (y != 0))
    assert (mesh.rim == border | beside).all()
    finest = mesh_levels(mesh, 0.001, tmp_path)[0]  # the hole stays open
    assert len(finest.boxes) > 4
    shown = [tile for _, tile in finest.tiles()]
    for tile in shown:
        dark = unpacked(tile.packed(0.001)).colors[:, 0] < 150
        assert (dark == tile.rim).all()
    rims = np.unique(np.concatenate([tile.points_m[tile.rim] for tile in shown]), axis=0)
    assert len(rims) == (border | beside).sum()


@pytest.mark.usefixtures("small_pieces")
def test_the_finest_level_is_the_mesh_and_the_coarsest_is_small(tmp_path: Path) -> None:
    mesh = hills()
    finest, *coarser = mesh_levels(mesh, 0.01, tmp_path)
    assert finest.cell_m == 0.01
    assert len(finest.boxes) > 4
    assert finest.triangles == len(mesh.triangles)
    assert set.union(*(as_set(tile, 1e-4) for _, tile in finest.tiles())) == as_set(mesh, 1e-4)
    assert [level.cell_m for level in coarser] == [
        0.01 * 2**level for level in range(1, len(coarser) + 1)
    ]
    assert coarser[-1].triangles <= 300
    for fine, coarse in zip([finest, *coarser], coarser, strict=False):
        assert {(column // 2, row // 2) for column, row in fine.boxes} >= coarse.boxes.keys()
        assert sum(len(tile.triangles) for _, tile in coarse.tiles()) == coarse.triangles


def as_fused(mesh: Piece) -> Piece:
    """A mesh with its points and triangles square by square."""
    order = np.lexsort(np.floor(mesh.points_m[:, :2] / 0.2).T)
    place = np.argsort(order)
    triangles = mesh.triangles[np.lexsort(np.floor(mesh.middles_m / 0.2).T)]
    return Piece(mesh.points_m[order], mesh.colors[order], place[triangles], mesh.rim)


@pytest.mark.slow
def test_memory_does_not_grow_with_the_map(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """A map of four times as many triangles, in the order in which a map is fused: tiles of its
    coarsest levels alone are larger.
    """
    monkeypatch.setattr("stereo_seecolor.report.mesh_levels.SIZES", MeshSizes(1000, 2000))
    monkeypatch.setattr("stereo_seecolor.report.mesh_levels.PART", 1000)
    most, thresholds = [], gc.get_threshold()
    gc.set_threshold(700, 10, 10)  # reading numpy's headers leaves small cycles, which others keep
    for count in (150, 300):
        mesh = as_fused(hills(count))
        tracemalloc.start()
        found = mesh_levels(mesh, 0.01, tmp_path / str(count))
        most.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
        assert found[0].triangles == len(mesh.triangles)
    gc.set_threshold(*thresholds)
    assert most[1] < 2.5 * most[0]


@pytest.mark.slow
@pytest.mark.usefixtures("small_pieces")
def test_no_level_has_a_gap_that_the_whole_mesh_has_not(tmp_path: Path) -> None:
    """Tiles of each level, as the page unpacks them, fit without cracks: all edges of an odd number
    of triangles are of the mesh's own boundary, moved by no more than its cells.
    """
    mesh = hills()
    away = np.hypot(*(mesh.points_m[mesh.triangles].mean(axis=1)[:, :2] - (5.3, -2.7)).T)
    mesh = replace(mesh, triangles=mesh.triangles[away > 0.1])  # a gap of 20 cm
    rim = mesh.points_m[np.stack(boundary(mesh.triangles))].reshape(-1, 3)
    for level in mesh_levels(mesh, 0.01, tmp_path):
        cell_m = level.cell_m
        step_m = cell_m / 16
        shown = [unpacked(tile.packed(step_m)) for _, tile in level.tiles()]
        points = np.concatenate([tile.points_m for tile in shown])
        counts = np.cumsum([0] + [len(tile.points_m) for tile in shown])
        triangles = np.concatenate(
            [tile.triangles + first for tile, first in zip(shown, counts, strict=False)]
        )
        _, same = np.unique(np.rint(points / step_m).astype(int), axis=0, return_inverse=True)
        place = np.zeros((same.max() + 1, 3))
        place[same.ravel()] = points
        edges = place[np.stack(boundary(same.ravel()[triangles]))].reshape(-1, 3)
        assert len(edges) > 50 / (cell_m / 0.01)
        gaps = np.linalg.norm(edges[:, None] - rim, axis=2).min(axis=1)
        assert gaps.max() < 2 * cell_m
        inner = np.hypot(*(edges[:, :2] - (5.3, -2.7)).T) < 0.2
        assert inner.any() == (
            cell_m < 0.1
        )  # the gap is there, as long as it is larger than a cell


@pytest.mark.parametrize("edges", [3, 4, 6])
def test_holes_that_one_voxel_leaves_are_closed_and_larger_ones_stay(edges: int) -> None:
    """One triangle, the two of a square, those around a point; faces of the closed holes look as
    those around them.
    """
    mesh = hills()
    middles = mesh.middles_m
    few = np.argsort(np.hypot(*(middles - (5.105, -2.895)).T))[: edges - 2]
    if edges == 6:
        point = np.hypot(*(mesh.points_m[:, :2] - (5.1, -2.9)).T).argmin()
        few = np.flatnonzero((mesh.triangles == point).any(axis=1))
        assert len(few) == 6
    many = np.hypot(*(middles - (5.4, -2.6)).T) < 0.03
    kept = ~many
    kept[few] = False
    open_mesh = replace(mesh, triangles=mesh.triangles[kept])
    filled = replace(mesh, triangles=closed(mesh.points_m, open_mesh.triangles, 0.01))
    assert len(filled.triangles) == kept.sum() + edges - 2
    a, b, c = (filled.points_m[corner] for corner in filled.triangles.T)
    assert np.sign(np.cross(b - a, c - a)[:, 2]).min() == 1
    left, wanted = boundary(filled.triangles), boundary(mesh.triangles[~many])
    assert set(np.unique(left)) == set(np.unique(wanted))  # of the rim and the large hole


def test_a_closed_surface_and_one_of_no_triangles_stay_as_they_are() -> None:
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], float)
    faces = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]])
    np.testing.assert_array_equal(closed(corners, faces, 1), faces)
    assert len(closed(corners, faces[:3], 1)) == 4
    assert closed(corners, faces[:0], 1).shape == (0, 3)


def test_heights_are_exact_to_a_twentieth_of_a_millimeter() -> None:
    rng = np.random.default_rng(3)
    heights_m = (-12 + np.cumsum(rng.normal(0, 0.01, (70, 90)), axis=1)).astype(np.float32)
    heights_m[rng.random(heights_m.shape) < 0.2] = np.nan
    packed = coded_heights(heights_m)
    codes = numbers_of(packed["heights"]).reshape(heights_m.shape)
    found = np.where(codes > 0, packed["low_m"] + (codes - 1) * packed["step_m"], np.nan)
    assert (np.isnan(found) == np.isnan(heights_m)).all()
    assert np.nanmax(abs(found - heights_m)) < 5e-5


def test_a_coarse_mesh_lies_on_the_fine_one() -> None:
    mesh = hills()
    part = Numbered(mesh.points_m, mesh.colors, mesh.triangles, mesh.rim, np.arange(3600))
    coarse = cluster_vertices(part, 0.03, mesh.points_m.min(axis=0).astype(float))
    assert len(coarse.points_m) < 600
    x, y = coarse.points_m[:, 0] - 5, coarse.points_m[:, 1] + 3
    assert abs(coarse.points_m[:, 2] - 0.1 * np.sin(9 * x) * np.cos(7 * y)).max() < 0.01


def test_a_pyramid_is_the_image_at_every_level() -> None:
    image = np.dstack(
        [np.tile(np.arange(1100) // 5, (700, 1)).astype(np.uint8)] * 3
        + [np.full((700, 1100), 255, np.uint8)]
    )

    def read(box: tuple[int, int, int, int], size: tuple[int, int]) -> np.ndarray:
        left, top, width, height = box
        return cv2.resize(
            image[top : top + height, left : left + width], size, interpolation=cv2.INTER_AREA
        )

    contents = dict(pyramid(1100, 700, read))
    tiles = {
        name: cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_UNCHANGED)
        for name, content in contents.items()
    }
    finest = levels(1100, 700) - 1
    assert (finest, tiles["8/0_0.webp"].shape[:2]) == (11, (88, 138))
    assert {name for name in tiles if name.startswith("11/")} == {
        f"11/{x}_{y}.webp" for x in range(3) for y in range(2)
    }
    assert tiles["11/2_1.webp"].shape[:2] == (700 - 512, 1100 - 1024)
    assert abs(int(tiles["11/1_0.webp"][100, 100, 0]) - image[100, 612, 0]) < 6


@pytest.mark.slow
def test_a_map_is_packed_once_and_again_after_another_fusion(tmp_path: Path) -> None:
    out = write_map(tmp_path / "out", flat_frames(3), "prior")
    report(out)
    page = (out / "index.html").read_text("utf-8")
    assert "3 frames along 0.6 m of track were fused" in page
    first = {
        path: path.stat().st_mtime_ns for path in (out / "page/map").rglob("*") if path.is_file()
    }
    folders = {"map.js", "mosaic", "terrain", "hillshade", "heights", "gaps", "squares"}
    meshes = {"0_0_0.js", "textured_0_0_0.js", "whole.js"}
    assert {path.name for path in (out / "page/map").iterdir()} == meshes | folders
    (coarsest,) = (path.name for path in (out / "page/map/mosaic").iterdir())
    report(out)
    assert first == {
        path: path.stat().st_mtime_ns for path in (out / "page/map").rglob("*") if path.is_file()
    }
    fuse(out, tmp_path / "nav.tum", RunConfig(mapping=CONFIG.model_copy(update={"mosaic_m": 0.04})))
    report(out)
    levels_now = {path.name for path in (out / "page/map/mosaic").iterdir()}
    # half as many pixels a side; the earlier mosaic is gone
    assert levels_now == {str(int(coarsest) - 1)}


@pytest.mark.slow
def test_a_damaged_map_is_named_and_the_page_goes_without_it(tmp_path: Path) -> None:
    out = write_map(tmp_path / "out", flat_frames(3), "prior")
    report(out)
    for name in (MESH, "map.json", "trajectory.tum", "poses.csv"):
        path = out / "map" / name
        content = path.read_bytes()
        path.write_bytes(content[: len(content) // 3] if name == MESH else b"")
        found = report(out)
        assert list(found.left_out) == ["map"], name
        assert not (out / "page/map/map.js").exists()
        path.write_bytes(content)
    assert not report(out).left_out
    assert (out / "page/map/map.js").is_file()


@pytest.mark.slow
def test_a_map_that_could_not_be_packed_leaves_nothing_behind(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    out = write_map(tmp_path / "out", flat_frames(3), "prior")
    with monkeypatch.context() as patched:
        patched.setattr("stereo_seecolor.report.map_texture._page", None)
        with pytest.raises(TypeError):
            report(out)
    assert not [path for path in (out / "page/map").rglob("*") if path.is_file()]


@pytest.mark.slow
@pytest.mark.usefixtures("small_pieces")
def test_the_list_holds_the_coarsest_pieces_and_each_script_those_below_it(tmp_path: Path) -> None:
    """From the list all are found, one level after the other, inside the boxes of those above."""
    out = write_map(tmp_path / "out", flat_frames(3), "prior")
    report(out)
    folder = out / "page/map"

    def below(name: str, entry: dict[str, Any], listed: dict[str, Any]) -> set[str]:
        listed = listed | script_values(folder / f"{name}.js")[-1]
        names = {f"{name}.js"}
        for finer in entry["finer"]:
            assert (np.array(listed[finer]["low_m"]) >= entry["low_m"]).all()
            assert (np.array(listed[finer]["high_m"]) <= entry["high_m"]).all()
            names |= below(finer, listed[finer], listed)
        return names

    (about,) = script_values(folder / "map.js")
    assert len(about["pieces"]) == 1
    found = {
        name
        for listed in (about["pieces"], about["textured"])
        for top, entry in listed.items()
        for name in below(top, entry, listed)
    }
    assert len(found) > 10
    assert found == {path.name for path in folder.glob("*.js")} - {"map.js"}


@pytest.mark.slow
@pytest.mark.usefixtures("small_pieces")
def test_a_scrap_that_no_coarser_level_shows_stays_a_piece_of_its_own(tmp_path: Path) -> None:
    out = write_map(tmp_path / "out", flat_frames(3), "prior")
    path = out / "map" / MESH
    vertices, faces = np.array(read_vertices(path)), np.array(read_triangles(path))
    scrap = np.resize(vertices, 3)
    corner_m = vertices["position"].max(axis=0) + 0.5
    scrap["position"] = corner_m + 1e-4 * np.eye(3)
    face = np.resize(faces, 1)
    face["indices"] = len(vertices) + np.arange(3)
    vertices, faces = np.append(vertices, scrap), np.append(faces, face)
    head = header("", vertices.dtype, len(vertices), len(faces))
    path.write_bytes(head + vertices.tobytes() + faces.tobytes())
    report(out)
    (about,) = script_values(out / "page/map/map.js")
    beyond = [each["low_m"][0] > corner_m[0] - 0.1 for each in about["pieces"].values()]
    assert sorted(beyond) == [False, True]
    assert not (out / "page/map/whole.js").exists()


@pytest.mark.slow
def test_a_map_has_the_colors_from_before_correction_where_the_page_has_its_pictures(
    tmp_path: Path,
) -> None:
    out = write_map(tmp_path / "out", flat_frames(3), "prior")
    report(out)
    (out / "page/before").mkdir(exist_ok=True)
    for i in range(3):
        cv2.imwrite(
            str(out / f"page/before/f{i}.jpg"),
            np.full((*PAIR.image_size[::-1], 3), (200, 90, 30), np.uint8),
        )
    report(out)
    (tile,) = (out / "page/map/raw").rglob("0_0.webp")
    found = cv2.imdecode(np.frombuffer(tile.read_bytes(), np.uint8), cv2.IMREAD_UNCHANGED)
    # WebP leaves out an opacity that is whole
    alpha = found[..., 3] if found.shape[2] == 4 else np.full(found.shape[:2], 255)
    assert (alpha > 0).mean() > 0.5
    assert abs(found[alpha > 250][:, :3].mean(axis=0) - (200, 90, 30)).max() < 4
    for name, is_raw in (("0_0_0", True), ("whole", False)):
        piece = parts_of(out / f"page/map/{name}.js")[0]
        found = np.median(unpacked(piece).colors, axis=0)
        assert (abs(found[::-1] - (200, 90, 30)).max() < 4) == is_raw


ALTITUDE_M = 1.5
PIXEL_M = ALTITUDE_M / PAIR.focal_px


def lines_frame(i: int, period_m: float) -> SurveyFrame:
    """A frame of ``track`` over level ground, gray by a sine across the map."""
    column, row = np.meshgrid(np.arange(160.0), np.arange(128.0))
    x_m = 0.3 * i + (column - PAIR.cx_left_px) * PIXEL_M
    y_m = -(row - PAIR.cy_px) * PIXEL_M
    gray = 128 + 80 * np.sin(2 * np.pi * (x_m + y_m) / np.sqrt(2) / period_m)
    return replace(flat_frame(i, ALTITUDE_M), color=np.repeat(gray[..., None], 3, -1).astype("u1"))


def amplitude(x_m: np.ndarray, y_m: np.ndarray, gray: np.ndarray, period_m: float) -> float:
    """How strong those lines are in gray values of spots, of least squares."""
    phase = 2 * np.pi * (x_m + y_m) / np.sqrt(2) / period_m
    terms = np.stack([np.ones_like(phase), np.sin(phase), np.cos(phase)], axis=1)
    return float(np.hypot(*np.linalg.lstsq(terms, gray, rcond=None)[0][1:]))


@pytest.mark.slow
@pytest.mark.parametrize(("period_px", "kept"), [(4, 0.9), (8, 0.95)])
def test_the_surface_shows_lines_as_strong_as_the_frames_do(
    period_px: int, kept: float, tmp_path: Path
) -> None:
    """Lines of two and of four pixels, not along those of the frames, on the finest tiles."""
    period_m = period_px * PIXEL_M
    out = write_map(tmp_path / "out", [lines_frame(i, period_m) for i in range(4)])
    report(out)
    spots, grays = [], []
    for path in (out / "page/map").glob("textured_0_*.js"):
        for page in parts_of(path):
            if "jpeg" not in page:  # the rim, which no image shows
                continue
            image = cv2.imdecode(np.frombuffer(page["jpeg"], np.uint8), cv2.IMREAD_GRAYSCALE)
            points_m, corners = surface_of(page)
            uv = numbers_of(page["uv"]).reshape(2, -1).T / page["uv_steps"] - 0.5
            for weights in np.random.default_rng(1).dirichlet(np.ones(3), 4):
                inside = np.einsum("k,tkc->tc", weights, points_m[corners])
                place = np.einsum("k,tkc->tc", weights, uv[corners]).astype(np.float32)
                sampled = cv2.remap(image, place[:, None], None, cv2.INTER_LANCZOS4)
                spots.append(inside)
                grays.append(sampled[:, 0].astype(float))
    offset_m = np.array(json.loads((out / "map/map.json").read_text())["offset_m"])
    x_m, y_m, _ = (np.concatenate(spots) + offset_m).T
    assert len(x_m) > 1000
    assert amplitude(x_m, y_m, np.concatenate(grays), period_m) > kept * 80
