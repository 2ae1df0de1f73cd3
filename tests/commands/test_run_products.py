"""What a run writes: every file at its size, depth and format, with the numbers that it stands
for.
"""

import csv
import json

import cv2
import numpy as np
import pytest
from conftest import contents, read_pixels


@pytest.mark.slow
def test_run_writes_the_whole_folder(make_dive, cli, tmp_path) -> None:
    dive, out = make_dive(), tmp_path / "out"
    code, printed, said = cli(*dive.command(out))
    assert code == 0, said
    assert "3 pairs done, 0 failed" in printed
    assert str(out / "corrected") in printed
    names = {"0000", "0001", "0002"}
    for product, suffix in (
        ("corrected", "png"),
        ("range", "tiff"),
        ("range_std", "tiff"),
        ("clouds", "ply"),
        ("mask", "png"),
    ):
        assert {path.name for path in (out / product).iterdir()} == {
            f"{name}.{suffix}" for name in names
        }
    range_m = read_pixels(out / "range" / "0001.tiff")
    known = np.isfinite(range_m)
    assert range_m.dtype == np.float32
    assert known.mean() > 0.6
    error_px = 15 * np.abs(1 / range_m - 1 / dive.range_m)[known]  # f B = 15 px m
    assert np.median(error_px) < 0.2
    corrected = read_pixels(out / "corrected" / "0001.png")
    assert corrected.dtype == np.uint8
    assert corrected[known].any(axis=1).mean() > 0.9
    mask = read_pixels(out / "mask" / "0001.png")
    assert (mask[~known] != 0).all()
    assert corrected[mask == 2].any(axis=1).mean() > 0.9
    rows = list(csv.DictReader((out / "frames.csv").read_text().splitlines()))
    assert [(row["name"], row["status"]) for row in rows] == [
        (name, "ok") for name in sorted(names)
    ]
    assert all(float(row["coverage"]) > 0.6 and float(row["match_s"]) > 0 for row in rows)
    run = json.loads((out / "run.json").read_text())
    assert run["totals"]["ok"] == 3
    assert run["geometry"]["baseline_m"] == pytest.approx(0.1)
    assert len(run["inputs"]["files"]["0000"]["left"]) == 64
    assert run["config"]["color"]["lock"]
    assert json.loads((out / "water.json").read_text())["format"] == "stereo-seecolor/water"


@pytest.mark.slow
def test_cloud_holds_the_measured_points_in_the_corrected_colors(make_dive, cli, tmp_path) -> None:
    cli(*make_dive(1).command(tmp_path / "out"))
    _, _, body = (tmp_path / "out/clouds/0000.ply").read_bytes().partition(b"end_header\n")
    vertices = np.frombuffer(body, np.dtype([("xyz", "<f4", 3), ("rgb", "u1", 3)]))
    range_m = read_pixels(tmp_path / "out/range/0000.tiff")
    measured = np.isfinite(range_m) & (read_pixels(tmp_path / "out/confidence/0000.png") > 0)
    assert len(vertices) == measured.sum()
    np.testing.assert_allclose(
        np.linalg.norm(vertices["xyz"], axis=1), range_m[measured], rtol=1e-5
    )
    np.testing.assert_array_equal(
        vertices["rgb"], read_pixels(tmp_path / "out/corrected/0000.png")[..., ::-1][measured]
    )
    assert (vertices["xyz"][:, 2] > 0).all()


@pytest.mark.slow
def test_sixteen_bits_in_sixteen_bits_out(make_dive, cli, tmp_path) -> None:
    assert cli(*make_dive(1, dtype=np.uint16).command(tmp_path / "out"))[0] == 0
    corrected = read_pixels(tmp_path / "out/corrected/0000.png")
    assert corrected.dtype == np.uint16
    assert len(np.unique(corrected)) > 1000


@pytest.mark.slow
@pytest.mark.parametrize("image_format", ["png16", "tiff32", "jpg"])
def test_image_formats(make_dive, cli, tmp_path, image_format) -> None:
    assert (
        cli(
            *make_dive(1).command(tmp_path / "out", "--set", f"output.image_format={image_format}")
        )[0]
        == 0
    )
    suffix = {"png16": "png", "tiff32": "tiff", "jpg": "jpg"}[image_format]
    image = read_pixels(tmp_path / "out/corrected" / f"0000.{suffix}")
    assert image.dtype == {"png16": np.uint16, "tiff32": np.float32, "jpg": np.uint8}[image_format]
    assert np.isfinite(image).all()
    assert image.any()


@pytest.mark.slow
def test_gray_images_go_through(make_dive, cli, tmp_path) -> None:
    dive = make_dive(1)
    for path in dive.root.glob("?/*.png"):
        cv2.imwrite(str(path), read_pixels(path)[..., 1])
    assert cli(*dive.command(tmp_path / "out"))[0] == 0


@pytest.mark.slow
def test_result_is_the_same_with_any_number_of_workers(make_dive, cli, tmp_path) -> None:
    dive = make_dive(4)
    cli(*dive.command(tmp_path / "one", "--workers", "1"))
    cli(*dive.command(tmp_path / "three", "--workers", "3"))
    assert contents(tmp_path / "one") == contents(tmp_path / "three")


@pytest.mark.slow
def test_range_alone_and_correct_alone_give_the_same_images(make_dive, cli, tmp_path) -> None:
    dive = make_dive()
    # as correct takes unrelated images
    assert cli(*dive.command(tmp_path / "all", "--set", "color.lock=frame"))[0] == 0
    assert cli(*dive.command(tmp_path / "ranges", command="range"))[0] == 0
    assert not (tmp_path / "ranges/corrected").exists()
    words = [
        "correct",
        "--images",
        str(dive.root / "L"),
        "--range",
        str(tmp_path / "ranges/range"),
        "--out",
        str(tmp_path / "colors"),
    ]
    assert cli(*words)[0] == 0
    for path in (tmp_path / "all/corrected").iterdir():
        mask = tmp_path / "all/mask" / path.name
        assert (tmp_path / "colors/mask" / path.name).read_bytes() == mask.read_bytes()
        assert (tmp_path / "colors/corrected" / path.name).read_bytes() == path.read_bytes()
    code, _, said = cli("fuse", tmp_path / "colors")
    assert code == 1
    assert "has no calibration (made by correct?): a map needs the output of run" in said


@pytest.mark.slow
def test_rectified_images_need_no_more_rectification(make_dive, cli, tmp_path) -> None:
    dive, out = make_dive(1), tmp_path / "out"
    assert cli(*dive.command(out, command="rectify"))[0] == 0
    np.testing.assert_array_equal(
        read_pixels(out / "rectified_left/0000.png"), read_pixels(dive.root / "L/0000.png")
    )
    again = ["run", "--left", str(out / "rectified_left"), "--right", str(out / "rectified_right")]
    assert (
        cli(*again, "--calib", str(out / "rectified.yaml"), "--out", str(tmp_path / "out2"))[0] == 0
    )
