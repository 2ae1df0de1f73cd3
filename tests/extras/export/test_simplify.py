"""Meshes with fewer triangles: held against the original from both sides; small holes closed."""

from pathlib import Path

import numpy as np
import pytest
import trimesh
from mapping_scene import CONFIG, flat_frames, write_map

from stereo_seecolor.extras.export.simplified_surface import read_surface
from stereo_seecolor.extras.export.simplify import boundary_edges, simplify
from stereo_seecolor.files.ply import FACE, VERTEX, header, read_triangles, read_vertices
from stereo_seecolor.run_folder.posed_run import open_posed_run

BOUND_M = 0.004


def bottom(count: int = 60, noise_m: float = 0.001) -> tuple[np.ndarray, np.ndarray]:
    """A wavy bottom of 1 cm cells, with a hole and an outline that is not straight."""
    column, row = np.meshgrid(np.arange(count), np.arange(count))
    x, y = 0.01 * column, 0.01 * row
    z = 0.05 * np.sin(9 * x) * np.cos(7 * y) + np.random.default_rng(0).normal(0, noise_m, x.shape)
    position = np.stack([x, y, z], axis=-1).reshape(-1, 3)
    first = (row * count + column)[:-1, :-1].ravel()
    triangles = np.concatenate(
        [
            np.stack([first, first + 1, first + count], 1),
            np.stack([first + 1, first + count + 1, first + count], 1),
        ]
    )
    center = position[triangles].mean(axis=1)
    hole = np.hypot(center[:, 0] - 0.3, center[:, 1] - 0.3) < 0.08
    outside = center[:, 0] > 0.5 + 0.05 * np.sin(40 * center[:, 1])
    return position, triangles[~hole & ~outside]


def farthest(points: np.ndarray, position: np.ndarray, triangles: np.ndarray) -> float:
    """Largest distance of points to a surface: to its planes above the triangles, else to its
    edges.
    """
    corners = position[triangles]
    inverse = np.linalg.inv(
        np.stack(
            [corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0], _normals(corners)],
            axis=-1,
        )
    )
    start, along = corners, np.roll(corners, -1, axis=1) - corners
    largest = 0.0
    for point in points:
        v, w, off_m = np.einsum("fij,fj->if", inverse, point - corners[:, 0])
        above = np.abs(off_m[(v >= 0) & (w >= 0) & (v + w <= 1)])
        t = np.clip(((point - start) * along).sum(-1) / (along**2).sum(-1), 0, 1)
        beside = np.linalg.norm(start + t[..., None] * along - point, axis=-1)
        largest = max(largest, min(above.min(initial=np.inf), beside.min()))
    return largest


def _normals(corners: np.ndarray) -> np.ndarray:
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return normals / np.linalg.norm(normals, axis=1, keepdims=True)


@pytest.mark.slow
def test_a_bottom_stays_within_the_bound() -> None:
    position, triangles = bottom()
    found = simplify(position, triangles, BOUND_M)
    left = position[found.kept]
    assert len(found.triangles) < len(triangles) / 8
    used = position[np.unique(triangles)]
    assert farthest(used, left, found.triangles) == pytest.approx(found.largest_m, abs=1e-6)
    assert 0.5 * BOUND_M < found.largest_m <= BOUND_M and 0 < found.rms_m < 0.6 * found.largest_m
    weights = np.random.default_rng(1).dirichlet([1, 1, 1], 10)
    assert (
        farthest(
            np.einsum("nk,fkc->fnc", weights, left[found.triangles]).reshape(-1, 3),
            position,
            triangles,
        )
        < 1.7 * BOUND_M
    )
    assert (_normals(left[found.triangles])[:, 2] > -1e-9).all(), "no triangle is turned over"


def test_the_outline_and_the_hole_stay() -> None:
    position, triangles = bottom()
    found = simplify(position, triangles, BOUND_M)
    edges = [
        _segments(p, t) for p, t in ((position, triangles), (position[found.kept], found.triangles))
    ]
    assert len(edges[1]) < len(edges[0]) / 2
    for start in edges[0][:, 0]:
        along = edges[1][:, 1] - edges[1][:, 0]
        t = np.clip(((start - edges[1][:, 0]) * along).sum(1) / (along**2).sum(1), 0, 1)
        assert (
            np.linalg.norm(edges[1][:, 0] + t[:, None] * along - start, axis=1).min()
            <= BOUND_M + 1e-9
        )


def _segments(position: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    face, corner = np.nonzero(boundary_edges(triangles))
    return position[np.stack([triangles[face, corner], triangles[face, (corner + 1) % 3]], axis=1)]


def test_a_plane_needs_few_triangles_and_keeps_its_area() -> None:
    position, triangles = bottom(noise_m=0)
    position[:, 2] = 0.3 * position[:, 0]
    before = trimesh.Trimesh(position, triangles, process=False).area
    found = simplify(position, triangles, 1e-7)
    after = trimesh.Trimesh(position[found.kept], found.triangles, process=False).area
    assert after == pytest.approx(before, rel=1e-6)
    assert len(found.triangles) < len(triangles) / 5


def test_a_sphere_stays_closed() -> None:
    sphere = trimesh.creation.icosphere(4, 0.1)
    found = simplify(sphere.vertices, sphere.faces, 0.002)
    mesh = trimesh.Trimesh(sphere.vertices[found.kept], found.triangles, process=False)
    assert mesh.is_watertight and mesh.euler_number == 2 and len(mesh.faces) < len(sphere.faces) / 8
    assert mesh.volume == pytest.approx(sphere.volume, rel=0.05)


def test_nothing_goes_where_nothing_may() -> None:
    position, triangles = bottom(12)
    found = simplify(position, triangles, 0.0)
    assert len(found.triangles) == len(triangles) and found.largest_m == 0
    empty = simplify(position, triangles[:0], 0.1)
    assert (len(empty.kept), len(empty.triangles), empty.rms_m) == (0, 0, 0)


def test_no_edge_gets_longer_than_is_asked() -> None:
    position, triangles = bottom(noise_m=0)
    found = simplify(position, triangles, 0.02, longest_m=0.05)
    corners = position[found.kept][found.triangles]
    assert (
        0.04 < np.linalg.norm(np.roll(corners, 1, axis=1) - corners, axis=-1).max() <= 0.05 + 1e-9
    )


@pytest.mark.slow
@pytest.mark.parametrize(("radius_m", "is_closed"), [(0.02, True), (0.15, False)])
def test_a_hole_of_one_voxel_is_closed_and_a_gap_stays(
    tmp_path: Path, radius_m: float, is_closed: bool
) -> None:
    """Of the mesh that is textured: the triangles around a place in the middle are missing."""
    out = write_map(tmp_path / "out", flat_frames(3))
    path = out / "map" / "mesh.ply"
    vertices, faces = np.array(read_vertices(path)), np.array(read_triangles(path))
    place = vertices["position"][:, :2]
    middle = place[np.hypot(*(place - (0.3, 0)).T).argmin()]
    away = np.hypot(*(place[faces["indices"]].mean(axis=1) - middle).T)
    kept = faces[away > radius_m]
    assert 0 < len(faces) - len(kept) < 0.2 * len(faces)
    path.write_bytes(
        header("", VERTEX, len(vertices), len(kept))
        + vertices.astype(VERTEX).tobytes()
        + kept.astype(FACE).tobytes()
    )
    surface = read_surface(open_posed_run(out))
    edge = boundary_edges(surface.triangles)
    ends = surface.position[surface.triangles[edge.any(axis=1)]].reshape(-1, 3)
    is_open = (np.hypot(*(ends[:, :2] - middle).T) < radius_m + CONFIG.voxel_m).any()
    assert is_open != is_closed
