"""The textured surface of a drawn bottom with a box on it: colors, detail and seams against what
was drawn.
"""

import json
import re
import shutil
import subprocess
from pathlib import Path

import cv2
import numpy as np
import pytest
import trimesh
from mapping_scene import PAIR, track, write_map

from stereo_seecolor.extras.export import tiles_3d
from stereo_seecolor.extras.export.command import export
from stereo_seecolor.files.ply import read_triangles
from stereo_seecolor.records import SurveyFrame
from stereo_seecolor.run_folder.posed_run import PosedRun, open_posed_run
from stereo_seecolor.texture import textured
from stereo_seecolor.texture.views import Views

FRAMES = 5
BOX_LOW, BOX_HIGH = np.array([0.3, -0.15, -0.1]), np.array([0.6, 0.15, 0.3])
BOX_COLOR = (220, 60, 200)
PERIOD_M = 0.03
"""Of the drawn line pairs: four pixels, one and a half voxels."""
GAINS = (1.0, 0.9, 1.1, 0.93, 1.05)


def pattern(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Colors of the bottom: slow waves, and line pairs where y > 0.2."""
    lines = np.where(y > 0.2, 40 * np.sin(2 * np.pi * x / PERIOD_M), 0)
    return np.stack(
        [
            120 + 40 * np.sin(3 * x) + lines,
            110 + 30 * np.cos(4 * y) + lines,
            90 + 20 * np.sin(2 * x + y) + lines,
        ],
        -1,
    )


def drawn(number: int, gain: float) -> SurveyFrame:
    eye = track(FRAMES).T_world_camera[number, :3, 3]
    column, row = np.meshgrid(np.arange(160), np.arange(128))
    ray = np.stack([(column - 80) / 200, -(row - 64) / 200, -np.ones(row.shape)], axis=-1)
    with np.errstate(divide="ignore", invalid="ignore"):
        ends = np.sort(np.stack([(BOX_LOW - eye) / ray, (BOX_HIGH - eye) / ray]), axis=0)
    into, out = ends[0].max(axis=-1), ends[1].min(axis=-1)
    box = into < np.minimum(out, eye[2])
    depth_m = np.where(box, into, eye[2])
    place = eye + depth_m[..., None] * ray
    color = gain * np.where(box[..., None], BOX_COLOR, pattern(place[..., 0], place[..., 1]))
    range_m = (depth_m * PAIR.ray_length).astype(np.float32)
    rgb = np.clip(np.rint(color), 0, 255).astype(np.uint8)
    return SurveyFrame(
        f"f{number}",
        float(number),
        rgb,
        range_m,
        0.004 * range_m**2,
        np.full(range_m.shape, 255, np.uint8),
    )


def made(folder: Path, gains: tuple[float, ...]) -> Path:
    return write_map(folder / "out", [drawn(i, gain) for i, gain in enumerate(gains)])


@pytest.fixture(scope="module")
def fused(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return made(tmp_path_factory.mktemp("even"), (1.0,) * FRAMES)


@pytest.fixture(scope="module")
def uneven(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return made(tmp_path_factory.mktemp("uneven"), GAINS)


def samples(file: Path, count: int = 40_000) -> tuple[np.ndarray, np.ndarray]:
    """Places on the surface of a file as trimesh reads it, z up, and the colors of its texture
    there.
    """
    scene = trimesh.load(file, force="scene")
    places, colors = [], []
    for mesh in scene.dump():
        points, face = trimesh.sample.sample_surface(mesh, count // len(scene.geometry), seed=1)
        weights = trimesh.triangles.points_to_barycentric(mesh.triangles[face], points)
        uv = np.einsum("nk,nkc->nc", weights, mesh.visual.uv[mesh.faces[face]])
        material = mesh.visual.material
        image = np.asarray(
            (getattr(material, "baseColorTexture", None) or material.image).convert("RGB")
        )
        at = uv * (1, -1) * image.shape[1::-1] + (0, image.shape[0]) - 0.5
        sampled = [
            cv2.remap(image, *part.T[..., None].astype(np.float32), cv2.INTER_LINEAR)
            for part in np.array_split(at, 4)
        ]
        places.append(points), colors.append(np.concatenate(sampled)[:, 0].astype(float))
    found = np.concatenate(places)
    return found @ [
        [1, 0, 0],
        [0, 0, 1],
        [0, -1, 0],
    ] if file.suffix == ".glb" else found, np.concatenate(colors)


@pytest.mark.slow
@pytest.mark.parametrize(("format", "file"), [("textured-glb", "reef.glb"), ("obj", "reef.obj")])
def test_the_texture_has_the_colors_and_the_detail_of_the_bottom(
    fused: Path, tmp_path: Path, format: str, file: str
) -> None:
    export(fused, format, tmp_path / "to")
    points, colors = samples(tmp_path / "to" / file)
    x, y, z = points.T
    inside = (np.abs(y) < 0.42) & (x > -0.5) & (x < 1.7)
    bottom = (np.abs(z) < 0.004) & inside
    assert bottom.sum() > 0.5 * inside.sum()
    error = np.abs(colors - pattern(x, y))[bottom]
    assert np.median(error) < 2 and np.percentile(error, 95) < 12
    lined = bottom & (y > 0.23)
    wave = np.exp(2j * np.pi * x[lined] / PERIOD_M)
    level = np.polynomial.Polynomial.fit(x[lined], colors[lined, 0], 6)(x[lined])
    contrast = 2 * np.abs(((colors[lined, 0] - level) * wave).mean())
    assert contrast > 0.75 * 40, "line pairs of four pixels"
    top = np.abs(z - 0.3) < 0.01
    assert top.sum() > 500
    assert np.percentile(np.abs(colors - BOX_COLOR)[top], 90) < 12
    assert (np.abs(colors - BOX_COLOR).max(axis=1)[bottom] < 60).mean() < 0.002, (
        "the box is not painted onto the bottom behind it"
    )


def test_a_picture_is_read_without_its_ranges(fused: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Seams and painting need none."""
    views = Views(open_posed_run(fused))
    monkeypatch.setattr(PosedRun, "measured_range_m", None)
    assert views.picture(0).image.shape == (*PAIR.image_size[::-1], 3)
    with pytest.raises(TypeError):
        views.range_m(0)


@pytest.mark.slow
def test_seams_between_frames_of_other_brightness_are_leveled(
    uneven: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    export(uneven, "textured-glb", tmp_path / "leveled")
    with monkeypatch.context() as patch:
        patch.setattr(textured, "level", lambda views, surface, charts, across: charts)
        export(uneven, "textured-glb", tmp_path / "as_it_is")
    steps = {}
    for name in ("leveled", "as_it_is"):
        points, colors = samples(tmp_path / name / "reef.glb")
        x, y, z = points.T
        chosen = (np.abs(z) < 0.004) & (y < 0.15) & (y > -0.4) & (x > -0.4) & (x < 1.6)
        ratio = (colors / pattern(x, y))[chosen, 1]
        cells = (points[chosen, :2] / 0.05).astype(int)
        means = {
            cell: ratio[(cells == cell).all(axis=1)].mean()
            for cell in set(map(tuple, cells.tolist()))
        }
        steps[name] = np.percentile(
            [abs(means[c] - means[c[0] + 1, c[1]]) for c in means if (c[0] + 1, c[1]) in means], 95
        )
        assert 0.95 < np.median(ratio) < 1.05
    assert steps["leveled"] < 0.4 * steps["as_it_is"]


@pytest.mark.slow
def test_the_summary_tells_the_bound(fused: Path, tmp_path: Path) -> None:
    result = export(fused, "obj", tmp_path / "to")
    count = len(read_triangles(fused / "map" / "mesh.ply"))
    left = sum(
        line.startswith("f ") for line in (tmp_path / "to" / "reef.obj").read_text().splitlines()
    )
    assert left < 0.2 * count
    assert result.note.startswith(
        f"{left:,} of {count:,} triangles; the map's vertices lie at most "
    )
    assert "(bound 10.00 mm, rms" in result.note
    # neighbors overlap by three quarters: with fewer of them there are fewer seams
    assert re.search("at the images' 7.50 mm per pixel from [345] frames", result.note)


@pytest.mark.slow
def test_tiles_refine_down_to_the_finest(
    fused: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tiles_3d, "LIMITS", tiles_3d.TileLimits(triangles=60))
    result = export(fused, "3d-tiles", tmp_path / "to")
    root = json.loads((tmp_path / "to" / "tileset.json").read_text())["root"]
    whole, levels = samples(tmp_path / "to" / root["content"]["uri"])[0], []
    assert np.ptp(whole[:, 0]) > 2
    pending = [(root, 0)]
    while pending:
        tile, level = pending.pop()
        levels.append(level)
        low, high = (
            np.array(tile["boundingVolume"]["box"][:3]) + sign * _half(tile) for sign in (-1, 1)
        )
        mesh = trimesh.load(tmp_path / "to" / tile["content"]["uri"], force="mesh")
        points = mesh.vertices @ np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]])
        assert (points >= low - 1e-5).all() and (points <= high + 1e-5).all()
        for child in tile.get("children", ()):
            assert child["geometricError"] < tile["geometricError"]
            inside = np.array(child["boundingVolume"]["box"][:3])
            assert (inside - _half(child) >= low - 1e-9).all() and (
                inside + _half(child) <= high + 1e-9
            ).all()
            pending.append((child, level + 1))
        assert "children" in tile or tile["geometricError"] == 0
    assert (
        result.note.startswith(f"{len(levels)} tiles in {max(levels) + 1} levels; the finest: ")
        and max(levels) >= 2
    )


def _half(tile: dict) -> np.ndarray:
    return np.diag(np.array(tile["boundingVolume"]["box"][3:]).reshape(3, 3))


@pytest.mark.slow
@pytest.mark.skipif(not shutil.which("node"), reason="Node is not installed")
def test_the_khronos_validator_finds_nothing(
    fused: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In the mesh with its texture, in that of colored vertices, and in tiles."""
    folder = tmp_path / "tools"
    folder.mkdir()
    install = [
        "npm",
        "install",
        "--silent",
        "--prefix",
        str(folder),
        "gltf-validator@2.0.0-dev.3.10",
    ]
    if subprocess.run(install, capture_output=True, check=False).returncode:
        pytest.skip("npm cannot install gltf-validator here")
    monkeypatch.setattr(tiles_3d, "LIMITS", tiles_3d.TileLimits(triangles=200))
    export(fused, "textured-glb", tmp_path / "one")
    export(fused, "glb", tmp_path / "other")
    export(fused, "3d-tiles", tmp_path / "tree")
    script = (
        "const "
        "fs=require('fs'),v=require('gltf-validator');Promise.all(process.argv.slice(1).map(f=>"
        "v.validateBytes(new Uint8Array(fs.readFileSync(f))).then(r=>r.issues.messages)))"
        ".then(r=>console.log(JSON.stringify(r.flat())))"
    )
    files = sorted(
        str(path) for path in tmp_path.glob("[ot]*/**/*.glb") if "node_modules" not in path.parts
    )
    assert len(files) > 5
    said = subprocess.run(
        ["node", "-e", script, *files], capture_output=True, text=True, check=True, cwd=folder
    )
    assert [
        message for message in json.loads(said.stdout) if message["code"] != "IMAGE_NPOT_DIMENSIONS"
    ] == []
