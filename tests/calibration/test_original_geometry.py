"""``output.geometry: original``: products in the left camera's own pixels lie where it saw the
scene, under its own names.
"""

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from calibration_boards import fisheye_rig, pinhole_rig, rendered
from conftest import Cli, Dive, contents
from PIL import ExifTags, Image
from test_calibration_port import port_rig
from test_calibration_rectification import rig_at

from calibration import Camera, Rectification, StereoRig
from calibration.formats import native
from calibration.original_view import OriginalView
from calibration.refraction import cameras_in_water
from stereo_seecolor.files.decode import read_array
from stereo_seecolor.files.tiff import encode_tiff
from stereo_seecolor.inputs.capture import read_capture
from stereo_seecolor.run_folder.finished_run import open_run

RIGS = {
    "pinhole": pinhole_rig,
    "fisheye": fisheye_rig,
    "port": port_rig,
    "vertical": lambda: rig_at(91.0),
}
ORIGINAL = ("--set", "output.geometry=original")
MARK = (231, 118)
NEAR_MARK_PX = 12
"""Column and row of a mark in a raw left image."""
PLANE_M = 1.1


@pytest.mark.slow
@pytest.mark.parametrize("name", RIGS)
def test_ranges_of_a_slope_come_back_to_the_pixels_that_saw_it(name: str) -> None:
    """A plane before the rectified camera, and the same plane met by the rays of the raw one."""
    rig = RIGS[name]()
    rectification, view = Rectification.from_rig(rig), OriginalView.from_rig(rig)
    normal, distance_m = np.array([0.2, -0.1, 1.0]), 1.5
    rectified_m = distance_m / (rectification.pair.rays @ normal)
    rectified_m *= np.linalg.norm(rectification.pair.rays, axis=-1)
    width, height = rig.left.image_size
    u, v = np.meshgrid(np.arange(0, width, 37), np.arange(0, height, 41))
    rays = (
        cameras_in_water(rig)[0].rays(np.column_stack([u.ravel(), v.ravel()]).astype(float))
        @ rectification.R_left.T
    )
    truth_m = (distance_m / (rays @ normal) * np.linalg.norm(rays, axis=-1)).reshape(u.shape)
    found_m = view.ranges(rectified_m.astype(np.float32))[v, u]
    seen = np.isfinite(found_m)
    assert seen.mean() > 0.6
    assert np.abs(found_m[seen] / truth_m[seen] - 1).max() < 3e-4
    x, y = (rays[:, :2] / rays[:, 2:] * rectification.pair.focal_px).T
    columns, rows = rectification.pair.image_size
    x, y = x + rectification.pair.cx_left_px, y + rectification.pair.cy_px
    inside = (x > 1) & (x < columns - 2) & (y > 1) & (y < rows - 2)
    assert (seen.ravel() == inside)[inside | ~seen.ravel()].all(), (
        "unknown only where the rectified image does not reach"
    )


@pytest.mark.slow
def test_no_range_is_made_up_between_two_surfaces() -> None:
    rig = pinhole_rig()
    view = OriginalView.from_rig(rig)
    width, height = Rectification.from_rig(rig).pair.image_size
    step_m = np.where(np.arange(width) < width // 2, 1.0, 3.0) * np.ones((height, 1))
    step_m[::5, ::3] = np.nan
    found_m = view.ranges(step_m.astype(np.float32))
    known_m = found_m[np.isfinite(found_m)]
    assert np.minimum(np.abs(known_m - 1), np.abs(known_m - 3)).max() < 1e-3
    unknown = view.mask(np.isnan(step_m))
    assert np.isnan(found_m[unknown]).all()


def photograph_plane(folder: Path, suffix: str = ".jpg") -> StereoRig:
    """Three pairs of a plane that the left camera looks at squarely, with a white mark in each left
    image; and their rig.
    """
    K = np.array([[520.0, 0, 243], [0, 520, 176], [0, 0, 1]])
    left = Camera(K, np.array([-0.25, 0.05, 0, 0, 0]), (480, 360))
    T = np.eye(4)
    T[:3, :3], T[0, 3] = cv2.Rodrigues(np.array([0.01, 0.04, -0.02]))[0], -0.1
    rig = StereoRig(
        left, Camera(K + np.diag([5.0, 4, 0]), np.array([-0.2, 0.04, 0, 0, 0]), (480, 360)), T
    )
    pose = np.eye(4)
    pose[2, 3] = PLANE_M
    for number in range(3):
        rng = np.random.default_rng(number)
        sand = cv2.GaussianBlur(rng.integers(0, 256, (700, 900), dtype=np.uint8), (0, 0), 1.0)
        sand = cv2.normalize(sand, None, 20, 120, cv2.NORM_MINMAX)
        for side, camera, extrinsic in (
            ("left", rig.left, np.eye(4)),
            ("right", rig.right, rig.T_right_left),
        ):
            (folder / side).mkdir(parents=True, exist_ok=True)
            gray = rendered(camera, extrinsic @ pose, sand, 520, np.array([-0.85, -0.65]))
            # blue, green, red
            picture = np.stack([gray * 0.9, gray, gray * 0.5], axis=-1).astype(np.uint8)
            if side == "left":
                picture[MARK[1] - 2 : MARK[1] + 3, MARK[0] - 2 : MARK[0] + 3] = 255
            save_photograph(
                folder / side / f"dive_{number}_{side[0].upper()}{suffix}", picture[..., ::-1]
            )
    native.write(rig, folder / "cam.yaml")
    return rig


def save_photograph(path: Path, rgb: np.ndarray) -> None:
    """With the EXIF that a camera writes."""
    exif = Image.Exif()
    exif[ExifTags.Base.Make] = "Reef"
    exif.get_ifd(ExifTags.IFD.Exif).update(
        {ExifTags.Base.DateTimeOriginal: "2024:05:06 07:08:09", ExifTags.Base.ExposureTime: 0.005}
    )
    if path.suffix == ".tif":
        path.write_bytes(encode_tiff(rgb, exif.tobytes()[6:]))
    else:
        Image.fromarray(rgb).save(
            path, exif=exif, **({"quality": 98} if path.suffix == ".jpg" else {})
        )


def place_of_mark(image: np.ndarray) -> np.ndarray:
    """(column, row) of the middle of the brightest square of five pixels."""
    squares = cv2.boxFilter(image.min(axis=2).astype(np.float32), -1, (5, 5))
    return np.array(np.unravel_index(squares.argmax(), squares.shape))[::-1]


def words(folder: Path, out: Path, *more: str) -> list[str]:
    sides = [
        "--left",
        str(folder / "left"),
        "--right",
        str(folder / "right"),
        "--calib",
        str(folder / "cam.yaml"),
    ]
    return ["run", *sides, "--out", str(out), *more]


@pytest.mark.slow
@pytest.mark.parametrize("suffix", [".jpg", ".tif"])
def test_a_point_keeps_its_pixel(cli: Cli, tmp_path: Path, suffix: str) -> None:
    rig = photograph_plane(tmp_path / "dive", suffix)
    assert cli(*words(tmp_path / "dive", tmp_path / "out", *ORIGINAL))[0] == 0
    run = open_run(tmp_path / "out")
    for frame in run.frames:
        raw = read_array(frame.left)
        path = frame.products["original/corrected"]
        assert path.relative_to(run.root) == Path("original/corrected") / frame.left.name
        corrected, range_m, mask = (
            frame.read(f"original/{product}") for product in ("corrected", "range", "mask")
        )
        assert (
            corrected.shape == raw.shape
            and corrected.dtype == raw.dtype
            and range_m.shape == mask.shape == raw.shape[:2]
        )
        assert np.array_equal(place_of_mark(corrected), place_of_mark(raw)) and np.array_equal(
            place_of_mark(raw), MARK
        )
        capture = read_capture(path.read_bytes())
        assert capture.exposure_s == 0.005 and capture.captured_s == 1714979289.0

        width, height = rig.left.image_size
        rows, columns = np.mgrid[:height, :width]
        rays = rig.left.rays(np.column_stack([columns.ravel(), rows.ravel()]).astype(float))
        truth_m = (PLANE_M * np.linalg.norm(rays, axis=1)).reshape(height, width)
        known = np.isfinite(range_m)
        assert known.mean() > 0.6
        # it is in the left image alone: no match is right
        off_mark = np.hypot(columns - MARK[0], rows - MARK[1]) > NEAR_MARK_PX
        errors = np.abs(range_m[known & off_mark] / truth_m[known & off_mark] - 1)
        assert (errors > 0.02).mean() < 1e-3, "wrong matches are few, and the geometry is right"
        assert np.median(range_m[known] / truth_m[known]) == pytest.approx(1, abs=1e-3)
        assert (mask[~known] == 2).all() and (mask[known] != 1).all()
        assert (corrected[~known].max(axis=1) > 0).mean() > 0.99, "the whole picture is corrected"


@pytest.mark.slow
def test_a_rectified_rig_gives_the_same_twice(
    cli: Cli, make_dive: Callable[..., Dive], tmp_path: Path
) -> None:
    """Nothing is resampled, so that both ways must agree to the bit, with the same brightness."""
    dive, out = make_dive(2), tmp_path / "out"
    assert cli(*dive.command(out, *ORIGINAL))[0] == 0
    for frame in open_run(out).frames:
        for product in ("corrected", "mask"):
            assert np.array_equal(frame.read(product), frame.read(f"original/{product}"))
        assert np.array_equal(frame.read("range"), frame.read("original/range"), equal_nan=True)


@pytest.mark.slow
def test_rectified_products_stay_as_they_are(
    cli: Cli, make_dive: Callable[..., Dive], tmp_path: Path
) -> None:
    """A map, a water and a score are made of these; so a run with originals holds both."""
    dive, plain, out = make_dive(2), tmp_path / "plain", tmp_path / "out"
    cli(*dive.command(plain))
    cli(*dive.command(out, *ORIGINAL))
    assert contents(out) == contents(plain)
    code, printed, _ = cli(*dive.command(out, *ORIGINAL))
    assert code == 0 and "2 of them kept" in printed
    assert cli(*dive.command(out))[0] == 0
    assert not (out / "original").exists() or not any((out / "original").rglob("*.*"))
    assert contents(out) == contents(plain)


@pytest.mark.slow
def test_overwrite_leaves_no_originals(
    cli: Cli, make_dive: Callable[..., Dive], tmp_path: Path
) -> None:
    dive, out = make_dive(2), tmp_path / "out"
    cli(*dive.command(out, *ORIGINAL))
    assert cli(*dive.command(out, "--overwrite"))[0] == 0
    assert not (out / "original").exists()


@pytest.mark.slow
def test_a_file_of_others_among_originals_is_refused(
    cli: Cli, make_dive: Callable[..., Dive], tmp_path: Path
) -> None:
    dive, out = make_dive(2), tmp_path / "out"
    cli(*dive.command(out, *ORIGINAL))
    mine = out / "original" / "corrected" / "mine.png"
    mine.write_bytes(b"mine")
    code, _, said = cli(*dive.command(out, *ORIGINAL))
    assert code == 1 and "mine.png: was not written by this program" in said
    assert mine.read_bytes() == b"mine"


def test_left_images_of_one_name_are_refused(
    cli: Cli, make_dive: Callable[..., Dive], tmp_path: Path
) -> None:
    dive = make_dive(2)
    for side in "LR":
        (dive.root / side / "0001.png").rename(dive.root / side / "A.png")
        (dive.root / side / "0000.png").rename(dive.root / side / "a.png")
    code, _, said = cli(*dive.command(tmp_path / "out", *ORIGINAL))
    assert code == 1 and "would both be a in OUT/original: rename one" in said
    assert not (tmp_path / "out").exists()
