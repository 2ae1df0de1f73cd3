"""Small holes of mosaic and mesh, filled on request in an export alone."""

from pathlib import Path

import numpy as np
import pytest
from mapping_scene import flat_frames, write_map

from stereo_seecolor.extras.export import filled
from stereo_seecolor.extras.export.command import export
from stereo_seecolor.extras.export.filled import fill_holes, rims
from stereo_seecolor.files.ply import FACE, VERTEX, header, read_triangles, read_vertices


def grid_mesh(cells: int, out: set[tuple[int, int]]) -> tuple[np.ndarray, np.ndarray]:
    """Vertices of a plane, normals up, 1 cm apart, and two triangles for each cell but those
    out.
    """
    side = cells + 1
    vertices = np.zeros(side * side, VERTEX)
    x, y = np.meshgrid(np.arange(side), np.arange(side))
    vertices["position"] = np.column_stack([x.ravel(), y.ravel(), 0 * x.ravel()]) / 100
    vertices["normal"], vertices["color"] = (0, 0, 1), (200, 100, 50)
    faces = []
    for row in range(cells):
        for column in range(cells):
            if (row, column) not in out:
                a = row * side + column
                faces += [[a, a + 1, a + side + 1], [a, a + side + 1, a + side]]
    return vertices, np.array(faces, np.int32)


def write_mesh(path: Path, vertices: np.ndarray, triangles: np.ndarray) -> None:
    faces = np.zeros(len(triangles), FACE)
    faces["count"], faces["indices"] = 3, triangles
    head = header("a plane", VERTEX, len(vertices), len(faces))
    path.write_bytes(head + vertices.tobytes() + faces.tobytes())


def area_m2(path: Path) -> float:
    vertices = read_vertices(path)["position"].astype(np.float64)
    a, b, c = np.moveaxis(vertices[read_triangles(path)["indices"]], 1, 0)
    up = np.cross(b - a, c - a)[:, 2]
    assert (up > 0).all(), "every triangle faces up"
    return float(up.sum() / 2)


SMALL = {(5, 5), (5, 6), (6, 5)}
LARGE = {(row, column) for row in range(15, 27) for column in range(15, 27)}


def test_holes_of_the_mesh_are_closed_and_nothing_else(tmp_path: Path) -> None:
    """Neither the large hole, nor the outer rim, nor that of an island of one cell."""
    island = {(row, column) for row in range(29, 32) for column in range(29, 32)} - {(30, 30)}
    vertices, triangles = grid_mesh(40, SMALL | LARGE | island)
    write_mesh(tmp_path / "mesh.ply", vertices, triangles)
    (tmp_path / "to").mkdir()
    assert filled._fill_mesh(tmp_path / "mesh.ply", tmp_path / "to") == 1
    before = area_m2(tmp_path / "mesh.ply")
    assert area_m2(tmp_path / "to/mesh.ply") - before == pytest.approx(len(SMALL) * 1e-4, rel=1e-4)
    assert area_m2(tmp_path / "to/mesh_filled.ply") == pytest.approx(len(SMALL) * 1e-4, rel=1e-4)
    assert (read_vertices(tmp_path / "to/mesh_filled.ply")["color"] == (200, 100, 50)).all()


def test_rims_run_around_what_is_missing() -> None:
    _, triangles = grid_mesh(4, {(1, 1)})
    assert sorted(len(loop) for loop in rims(triangles)) == [4, 16]
    assert rims(np.zeros((0, 3), np.int32)) == []


def picture(size: int = 60) -> np.ndarray:
    """A ramp of colors that was seen everywhere."""
    ramp = np.tile(np.linspace(20, 220, size), (size, 1))
    return np.stack([ramp, ramp, 255 - ramp, np.full_like(ramp, 255)]).astype(np.uint8)


def test_enclosed_parts_of_the_mosaic_are_filled_from_around() -> None:
    whole = picture()
    seen = whole.copy()
    for part in (np.s_[:, 20:26, 30:38], np.s_[:, 40:55, 40:55], np.s_[:, :4, 10:14]):
        seen[part] = 0  # a small hole, a large one, and a notch of the rim
    found, mask = fill_holes(seen, 10)
    assert mask.sum() == 6 * 8
    assert mask[20:26, 30:38].all()
    np.testing.assert_allclose(found[:3, mask].astype(int), whole[:3, mask], atol=12)
    assert (found[3, mask] == 255).all()
    np.testing.assert_array_equal(found[:, ~mask], seen[:, ~mask])


@pytest.mark.slow
def test_only_the_export_is_filled(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Holes across the borders of windows too, and the map's own files stay as they are."""
    import rasterio

    out = write_map(tmp_path / "out", flat_frames(5))
    path = out / "map/orthomosaic.tif"
    with rasterio.open(path, "r+") as file:
        rgba = file.read()
        inside = np.argwhere(rgba[3] > 0)
        row, column = (int(np.median(inside[:, i])) for i in (0, 1))
        rgba[:, row : row + 3, column : column + 4] = 0
        file.write(rgba)
    before = {name: name.read_bytes() for name in out.rglob("*") if name.is_file()}
    monkeypatch.setattr(filled, "WINDOW_PX", 16 * (row // 16 + 1) if row > 16 else row + 1)
    result = export(out, "filled", tmp_path / "to")
    assert {name: name.read_bytes() for name in out.rglob("*") if name.is_file()} == before
    with (
        rasterio.open(tmp_path / "to/orthomosaic.tif") as colors,
        rasterio.open(tmp_path / "to/orthomosaic_filled.tif") as mask,
    ):
        marked, pixels = mask.read(1) > 0, colors.read()
        assert colors.transform == mask.transform
    assert marked[row : row + 3, column : column + 4].all()
    np.testing.assert_array_equal(pixels[:, ~marked], rgba[:, ~marked])
    assert f"{int(marked.sum())} cells of the mosaic" in result.note
    assert {name.name for name in (tmp_path / "to").iterdir()} == {
        "orthomosaic.tif", "orthomosaic_filled.tif", "mesh.ply", "mesh_filled.ply",
    }  # fmt: skip
