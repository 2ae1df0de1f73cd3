"""Calibration from boards: known rigs are found again, bad views are named, and a real set keeps
its published figures.
"""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from calibration_boards import (
    SIZE,
    fisheye_rig,
    photograph_board,
    pinhole_rig,
    projected_views,
    rendered,
)

from calibration import CalibrationError, Camera, StereoRig
from calibration.aprilgrid import AprilGrid, Corners, marker
from calibration.boards.printing import print_target
from calibration.boards.target_views import TargetView, detect_view
from calibration.boards.targets import Charuco, Chessboard, parse_target
from calibration.calibrate import calibrate
from calibration.formats import load_rig
from calibration.gray import to_gray
from calibration.rectification import plan_rectification, rectified_points
from stereo_seecolor.compute.threads import Threads

BOARD = Chessboard(9, 6, 0.03)


@pytest.mark.slow
@pytest.mark.parametrize("rig", [pinhole_rig(), fisheye_rig()], ids=["pinhole", "fisheye"])
def test_known_rig_is_found_again(rig: StereoRig) -> None:
    views = projected_views(rig, BOARD, 16, 0.1, np.random.default_rng(3))
    found, report = calibrate(views, BOARD)
    assert found.left.model == rig.left.model
    assert found.left.K[0, 0] == pytest.approx(rig.left.K[0, 0], rel=0.002)
    assert found.right.K[1, 1] == pytest.approx(rig.right.K[1, 1], rel=0.002)
    assert found.baseline_m == pytest.approx(rig.baseline_m, rel=0.002)
    assert found.rms_px == pytest.approx(0.1 * np.sqrt(2), rel=0.1)
    assert report.lens.row_error_px < 0.25
    assert abs(found.baseline_m - rig.baseline_m) < 4 * report.lens.std[2]
    assert report.verdict[0] == "good"
    assert found.errors is not None
    assert 0.99 * report.focal_std <= found.errors.focal < 0.01
    assert found.errors.baseline < 0.005


@pytest.mark.slow
def test_eight_coefficients_where_five_do_not_reach() -> None:
    rig = pinhole_rig()
    rational = np.array([0.9, 0.35, 0.0005, -0.0004, 0.02, 1.25, 0.45, 0.06])
    rig = replace(
        rig,
        left=replace(rig.left, distortion=rational),
        right=replace(rig.right, distortion=rational),
    )
    views = projected_views(rig, BOARD, 14, 0.02, np.random.default_rng(0))
    found, report = calibrate(views, BOARD)
    assert report.lens.rms_px < 0.032
    assert found.baseline_m == pytest.approx(rig.baseline_m, rel=0.002)


@pytest.mark.slow
def test_bad_views_are_dropped_with_the_reason() -> None:
    rng = np.random.default_rng(5)
    views = projected_views(pinhole_rig(), BOARD, 12, 0.1, rng)
    late, blurred = views[4], views[9]
    assert late.right is not None and blurred.left is not None
    views[4] = replace(
        late, right=Corners(late.right.ids, late.right.pixels + np.array([0.0, 9.0]))
    )
    views[9] = replace(
        blurred, left=Corners(blurred.left.ids, blurred.left.pixels + rng.normal(0, 3, (54, 2)))
    )
    views.append(TargetView("nothing", SIZE, None, None))
    views.append(replace(views[0], name="small", image_size=(640, 480)))
    found, report = calibrate(views, BOARD)
    reasons = {view.name: view.reason for view in report.views if view.reason}
    assert set(reasons) == {"view4", "view9", "nothing", "small"}
    assert "exposed at different moments, or a camera moved" in str(reasons["view4"])
    assert "do not fit a flat board in left" in str(reasons["view9"])
    assert "not found in the left and the right image" in str(reasons["nothing"])
    assert found.baseline_m == pytest.approx(0.12, rel=0.003)


@pytest.mark.slow
def test_many_wrong_pairs_are_dropped() -> None:
    views = projected_views(pinhole_rig(), BOARD, 10, 0.1, np.random.default_rng(0))
    other = projected_views(pinhole_rig(), BOARD, 4, 0.1, np.random.default_rng(1))
    for number, wrong in enumerate(other):
        views[2 * number] = replace(views[2 * number], right=wrong.right)
    found, report = calibrate(views, BOARD)
    dropped = {
        view.name
        for view in report.views
        if view.reason and "paired wrongly, or a camera moved" in view.reason
    }
    assert dropped == {"view0", "view2", "view4", "view6"}
    assert found.baseline_m == pytest.approx(0.12, rel=0.005)


@pytest.mark.slow
def test_swapped_folders_are_suspicious() -> None:
    views = projected_views(pinhole_rig(), BOARD, 6, 0.1, np.random.default_rng(0))
    _, report = calibrate(
        [replace(view, left=view.right, right=view.left) for view in views], BOARD
    )
    assert any(line.startswith("suspicious") for line in report.lines())


@pytest.mark.slow
def test_views_all_from_the_front_do_not_pass_for_good() -> None:
    views = projected_views(pinhole_rig(), BOARD, 1, 0.1, np.random.default_rng(0))
    try:
        _, report = calibrate([replace(views[0], name=str(number)) for number in range(6)], BOARD)
    except CalibrationError as error:
        assert "tilt the target" in str(error)
    else:
        assert report.verdict[0] == "do it again"


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 3])
def test_boards_parallel_to_the_image_do_not_pass_for_good(seed: int) -> None:
    """They leave the focal length open: each fit stays where it began, some 50 % off."""
    rng = np.random.default_rng(seed)
    views = projected_views(pinhole_rig(), BOARD, 12, 0.1, rng, tilt=0.0)
    try:
        _, report = calibrate(views, BOARD)
    except CalibrationError as error:
        assert "tilt the target" in str(error)
    else:
        assert report.verdict[0] == "do it again"
        assert "standard error of the focal length" in report.verdict[1]
        assert "tilt the target" in report.verdict[1] and "bent" not in report.verdict[1]


@pytest.mark.slow
def test_few_views_in_one_corner_are_not_good() -> None:
    views = projected_views(pinhole_rig(), BOARD, 4, 0.1, np.random.default_rng(0))
    _, report = calibrate(views, BOARD)
    verdict, why = report.verdict
    assert verdict != "good"
    assert "4 views alone" in why
    assert report.coverage_picture().shape[2] == 3


@pytest.mark.slow
def test_empty_regions_are_named() -> None:
    views = projected_views(pinhole_rig(), BOARD, 24, 0.1, np.random.default_rng(0))
    left_half = [
        view for view in views if view.left is not None and view.left.pixels[:, 0].max() < 840
    ]
    _, report = calibrate(left_half, BOARD)
    assert "left image, top right" in report.empty_regions
    assert "left image, middle middle" not in report.empty_regions


def test_too_few_views_say_so() -> None:
    with pytest.raises(CalibrationError, match="0 of 2 pairs, at least 3 are needed"):
        calibrate([TargetView("a", SIZE, None, None), TargetView("b", SIZE, None, None)], BOARD)


@pytest.mark.parametrize("turns", [1, 2, 3])
def test_square_board_is_numbered_alike_in_both_views(turns: int) -> None:
    board = Chessboard(6, 6, 0.03)
    (view,) = projected_views(pinhole_rig(), board, 1, 0.0, np.random.default_rng(0))
    assert view.left is not None and view.right is not None
    turned = np.rot90(view.right.pixels.reshape(6, 6, 2), turns).reshape(-1, 2)
    np.testing.assert_allclose(
        board.same_labels(view.left, Corners(view.right.ids, turned)).pixels, view.right.pixels
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    "target",
    ["chessboard:9x6:30mm", "charuco:5X5_100:11x8:30mm:22mm", "charuco:DICT_4X4_50:8x6:3cm:0.02m"],
)
def test_printed_board_is_detected_in_rendered_images(target: str, tmp_path: Path) -> None:
    board = parse_target(target)
    print_target(board, tmp_path / "board.png", dpi=300)
    picture = cv2.imread(str(tmp_path / "board.png"), cv2.IMREAD_GRAYSCALE)
    camera = Camera(
        np.array([[700.0, 0, 325], [0, 700, 236], [0, 0, 1]]),
        np.array([-0.2, 0.05, 0, 0, 0]),
        (640, 480),
    )
    T = np.eye(4)
    T[:3, :3] = cv2.Rodrigues(np.array([0.3, -0.2, 0.1]))[0]
    T[:3, 3] = [-0.12, -0.09, 0.6]
    image = rendered(camera, T, picture, 300 / 0.0254, np.full(2, -2 * board.square_m))
    corners = board.detect(image)
    assert corners is not None
    truth = camera.project(board.points_m[corners.ids] @ T[:3, :3].T + T[:3, 3])
    if isinstance(board, Chessboard):
        corners = board.same_labels(Corners(corners.ids, truth), corners)
    assert np.sqrt(((corners.pixels - truth) ** 2).sum(axis=1).mean()) < 0.1


def test_pdf_holds_the_same_rectangles_as_the_png(tmp_path: Path) -> None:
    """Read the PDF's own numbers, paint them, and look for the board."""
    import re
    import zlib

    board = Charuco("4X4_50", 5, 7, 0.03, 0.022)
    print_target(board, tmp_path / "board.pdf")
    data = (tmp_path / "board.pdf").read_bytes()
    stream = data[data.index(b"stream\n") + 7 : data.index(b"\nendstream")]
    height_pt = float(re.search(rb"MediaBox \[0 0 \S+ (\S+)\]", data)[1])  # type: ignore[index]
    image = np.full((1700, 1300), 255, np.uint8)
    scale = 150 / 72
    for line in zlib.decompress(stream).decode().splitlines()[1:]:
        gray, x, y, w, h = (
            float(word) for word in re.match(r"(\S+) g (\S+) (\S+) (\S+) (\S+) re f", line).groups()
        )  # type: ignore[union-attr]
        top, bottom = (round((height_pt - edge) * scale) for edge in (y + h, y))
        image[top:bottom, round(x * scale) : round((x + w) * scale)] = gray * 255
    found = board.detect(image)
    assert found is not None
    assert found.ids.size == board.points_m.shape[0]
    across = np.linalg.norm(found.pixels[3] - found.pixels[0]) / 150 * 0.0254
    assert across == pytest.approx(3 * 0.03, rel=0.005)
    for number in range(1, 6):
        offset = int(data[data.index(b"xref") :].splitlines()[2 + number].split()[0])
        assert data[offset:].startswith(b"%d 0 obj" % number)


GRID = "aprilgrid:6x5:30mm:9mm"


def photographed(
    target: AprilGrid, folder: Path, tilt: tuple[float, float, float], upside_down: bool = False
) -> tuple:
    """A rendered image of a printed grid, and where its corners truly are. upside_down: tags count
    from the upper row on.
    """
    print_target(target, folder / "grid.png", dpi=600)
    picture = cv2.imread(str(folder / "grid.png"), cv2.IMREAD_GRAYSCALE)
    px_per_m, pitch = 600 / 0.0254, target.tag_m + target.space_m
    if upside_down:
        top = round((target.tag_m + target.space_m / 2) * px_per_m)
        rows = [
            picture[top + round(j * pitch * px_per_m) : top + round((j + 1) * pitch * px_per_m)]
            for j in range(target.rows)
        ]
        size = min(len(row) for row in rows)
        picture = np.concatenate([picture[:top], *(row[:size] for row in rows[::-1])])
    camera = Camera(
        np.array([[700.0, 0, 325], [0, 700, 236], [0, 0, 1]]),
        np.array([-0.2, 0.05, 0, 0, 0]),
        (640, 480),
    )
    T = np.eye(4)
    T[:3, :3] = cv2.Rodrigues(np.array(tilt))[0]
    T[:3, 3] = T[:3, :3] @ [-3 * pitch, -2.5 * pitch, 0] + [0, 0, 0.45]
    image = rendered(camera, T, picture, px_per_m, np.full(2, -pitch))
    return image, camera.project(target.points_m @ T[:3, :3].T + T[:3, 3])


@pytest.mark.slow
@pytest.mark.parametrize("tilt", [(-0.4, 0.3, 2.0), (0.1, 0.5, -3.0)])
def test_grids_of_apriltags_are_found_at_any_turn(tilt, tmp_path: Path) -> None:
    board = parse_target(GRID)
    assert isinstance(board, AprilGrid)
    image, truth = photographed(board, tmp_path, tilt)
    corners = board.detect(image)
    assert corners is not None
    assert corners.ids.size > 0.9 * len(board.points_m)
    assert np.sqrt(((corners.pixels - truth[corners.ids]) ** 2).sum(axis=1).mean()) < 0.1


@pytest.mark.slow
def test_grids_of_apriltags_are_found_in_haze_and_where_rows_count_downwards(
    tmp_path: Path,
) -> None:
    board = parse_target(GRID)
    assert isinstance(board, AprilGrid)
    image, truth = photographed(board, tmp_path, (0.3, -0.2, 0.1), upside_down=True)
    hazy = (100 + 0.12 * image + np.random.default_rng(0).normal(0, 2, image.shape)).astype(
        np.uint8
    )
    for seen, error_px in ((image, 0.5), (hazy, 0.7)):
        corners = board.detect(seen)
        assert corners is not None
        assert corners.ids.size > 0.8 * len(board.points_m)
        assert np.sqrt(((corners.pixels - truth[corners.ids]) ** 2).sum(axis=1).mean()) < error_px
    assert board.detect(np.full((480, 640), 90, np.uint8)) is None


def test_a_printed_tag_is_the_one_that_kalibr_prints() -> None:
    """Code 0 of the family 36h11 is 0xd5d628584, read row by row from the upper left; Kalibr's
    border has two cells.
    """
    code = np.array([int(bit) for bit in f"{0xD5D628584:036b}"]).reshape(6, 6)
    np.testing.assert_array_equal(~marker(0), np.pad(code, 2).astype(bool))
    points = AprilGrid(3, 2, 0.1, 0.03).points_m.reshape(-1, 4, 3)
    # tag 0 at the lower left, then to the right, then up
    np.testing.assert_allclose(points[0, 0], [0, 0.13, 0])
    np.testing.assert_allclose(points[[1, 3], 0], [[0.13, 0.13, 0], [0, 0, 0]])


@pytest.mark.slow
def test_a_rig_is_calibrated_by_a_grid_of_apriltags(tmp_path: Path, cli) -> None:
    (tmp_path / "april.yaml").write_text(
        "target_type: 'aprilgrid' #gridtype\ntagCols: 6\ntagRows: 5\ntagSize: 0.03 "
        "#m\ntagSpacing: 0.3\ncodeOffset: 0\n"
    )
    truth = photograph_board(tmp_path, str(tmp_path / "april.yaml"))
    sides = ("--left", tmp_path / "left", "--right", tmp_path / "right")
    code, text, said = cli(
        "calibrate", "--target", tmp_path / "april.yaml", *sides, "--out", tmp_path / "rig.yaml"
    )
    assert code == 3, said  # six views leave corners of the images without tags
    assert "do it again: standard error of ranges" in text
    found = load_rig(str(tmp_path / "rig.yaml"))
    assert found.baseline_m == pytest.approx(truth.baseline_m, rel=0.01)
    assert found.left.K[0, 0] == pytest.approx(truth.left.K[0, 0], rel=0.01)
    in_file, in_words = parse_target(str(tmp_path / "april.yaml")), parse_target(GRID)
    assert type(in_file) is type(in_words)
    np.testing.assert_allclose(in_file.points_m, in_words.points_m, rtol=0, atol=1e-12)


def test_target_files_of_kalibr(tmp_path: Path) -> None:
    file = tmp_path / "target.yaml"
    file.write_text(
        "target_type: checkerboard\ntargetCols: 6\ntargetRows: 7\nrowSpacingMeters: "
        "0.06\ncolSpacingMeters: 0.06\n"
    )
    assert parse_target(str(file)) == Chessboard(6, 7, 0.06)
    for text, message in (
        (
            "target_type: checkerboard\ntargetCols: 6\ntargetRows: 7\nrowSpacingMeters: "
            "0.05\ncolSpacingMeters: 0.06",
            "not square",
        ),
        (
            "target_type: circlegrid\ntargetCols: 6\ntargetRows: 7\nspacingMeters: 0.02",
            "aprilgrid and checkerboard targets are supported",
        ),
        (
            "target_type: aprilgrid\ntagCols: 6\ntagRows: 6\ntagSize: 88\ntagSpacing: 0.3",
            "is impossible for a target",
        ),
        (
            "target_type: aprilgrid\ntagCols: 6.5\ntagRows: 6\ntagSize: 0.088\ntagSpacing: 0.3",
            "whole number",
        ),
        ("tagCols: 6", "no 'target_type'"),
    ):
        file.write_text(text + "\n")
        with pytest.raises(CalibrationError, match=message):
            parse_target(str(file))


@pytest.mark.slow
@pytest.mark.parametrize(("drop", "place"), [((0,), "from view1 on"), ((4, 9), "from view5 on")])
def test_sides_out_of_step_are_named_and_no_rig_is_made(drop: tuple[int, ...], place: str) -> None:
    views = projected_views(pinhole_rig(), BOARD, 20, 0.1, np.random.default_rng(2))
    rights = [view.right for number, view in enumerate(views) if number not in drop]
    shifted = []
    for view, right in zip(views, rights, strict=False):
        assert view.left is not None and right is not None
        shifted.append(replace(view, right=BOARD.same_labels(view.left, right)))
    with pytest.raises(
        CalibrationError,
        match=rf"out of synchronization: {place} the right image 1 pair earlier fits.*right side "
        "lacks images",
    ):
        calibrate(shifted, BOARD)


def test_a_rig_that_its_views_contradict_is_refused() -> None:
    views = projected_views(pinhole_rig(), BOARD, 12, 0.1, np.random.default_rng(2))
    mixed = [
        replace(view, right=views[(5 * number + 3) % 12].right) for number, view in enumerate(views)
    ]
    with pytest.raises(CalibrationError):
        calibrate(mixed, BOARD)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("aprilgrid:6x6:88mm:88mm", "space between tags"),
        ("aprilgrid:30x30:20mm:6mm", "587 tags"),
        ("aprilgrid:6x6:88mm", "expected chessboard"),
        ("chessboard:9x6", "expected chessboard"),
        ("chessboard:9x6:24.23", "length with its unit"),
        ("chessboard:9by6:24mm", "columns x rows"),
        ("chessboard:9x6:24m", "is impossible for a target"),
        ("charuco:6X6_9:11x8:30mm:22mm", "no dictionary"),
        ("charuco:5X5_100:11x8:22mm:30mm", "smaller than its square"),
    ],
)
def test_target_that_cannot_be_meant(text: str, message: str) -> None:
    with pytest.raises(CalibrationError, match=message):
        parse_target(text)


@pytest.mark.slow
@pytest.mark.real_data
def test_real_chessboards(real_data: Path) -> None:
    board = parse_target("chessboard:9x6:24.23mm")

    def detect(number: int) -> TargetView:
        left, right = (
            cv2.imread(str(real_data / "chessboard" / f"{side}{number}.jpg"))
            for side in ("left", "right")
        )
        return detect_view(str(number), left, right, board)

    views = list(Threads(2).each(detect, range(1, 30)))
    rig, report = calibrate(views, board, medium="air")
    assert len(report.used) == 29
    assert rig.rms_px is not None and rig.rms_px <= 0.25
    assert rig.baseline_m == pytest.approx(0.0940, abs=0.0005)
    assert report.lens.row_error_px <= 0.25
    ten, _ = calibrate(views[::3], board, medium="air")
    assert ten.baseline_m == pytest.approx(rig.baseline_m, rel=0.01)
    assert ten.left.K[0, 0] == pytest.approx(rig.left.K[0, 0], rel=0.01)


def test_gray_of_sixteen_bits_uses_the_full_range() -> None:
    ramp = np.linspace(4000, 9000, 64 * 64).reshape(64, 64).astype(np.uint16)
    gray = to_gray(np.dstack([ramp, ramp, ramp * 0]))
    assert (gray.min(), gray.max()) == (0, 255)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("stretch", "sagitta_m", "named"),
    [(0.02, 0.0, "2.0% longer across than down"), (0.0, 0.002, "bent by 2.0 "), (0.0, 0.0, None)],
)
def test_the_shape_of_a_target_is_named_and_stated_errors_hold(
    stretch: float, sagitta_m: float, named: str | None
) -> None:
    """Views of a target printed longer one way, or bent, agree with each other, so that only the
    fitted shape tells how wrong the rig is.
    """
    rig = pinhole_rig()
    true = Chessboard(9, 6, 0.03)
    half_m = true.points_m[:, 0].max() / 2
    across = true.points_m[:, 0] / half_m - 1
    true.__dict__["points_m"] = true.points_m * [1 + stretch, 1, 1] + np.outer(
        sagitta_m * across**2, [0, 0, 1]
    )
    _, report = calibrate(projected_views(rig, true, 16, 0.1, np.random.default_rng(4)), BOARD)
    text = report.shape.text if report.shape else None
    assert (named in str(text)) if named else text is None
    off = np.abs(report.lens.figures[:3] - [rig.left.K[0, 0], rig.right.K[0, 0], rig.baseline_m])
    off[:2] -= 2.0  # fx and fy of this rig differ by that
    assert (off < 3 * report.lens.std[:3]).all()
    assert any("suspicious: the corners fit" in line for line in report.lines()) == bool(named)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("tag_mm", "space_mm", "fitting"), [(30, 9.3, "9.0"), (29.5, 9, "8.8"), (30, 9, None)]
)
def test_another_space_between_tags_is_named_and_stated_errors_hold(
    tag_mm: float, space_mm: float, fitting: str | None
) -> None:
    """Tags and spaces contradict each other, and which of them is right is not known."""
    rig = pinhole_rig()
    named = AprilGrid(6, 6, tag_mm / 1000, space_mm / 1000)
    views = projected_views(rig, AprilGrid(6, 6, 0.03, 0.009), 12, 0.1, np.random.default_rng(5))
    found, report = calibrate(views, named)
    text = report.shape.text if report.shape else None
    assert f"another space between tags: {fitting}" in str(text) if fitting else text is None
    assert found.errors is not None
    assert abs(found.baseline_m / rig.baseline_m - 1) < 3 * found.errors.baseline


@pytest.mark.slow
@pytest.mark.parametrize("seed", [31, 34])
def test_stated_errors_hold_where_boards_filled_the_middle_alone(seed: int) -> None:
    """Lenses are less certain beyond the corners that fitted them than focal lengths are."""
    rig = pinhole_rig()
    views = projected_views(rig, BOARD, 16, 0.1, np.random.default_rng(seed), 0.15, 1.5)
    found, report = calibrate(views, BOARD)
    x, y = np.meshgrid(np.linspace(10, SIZE[0] - 11, 16), np.linspace(10, SIZE[1] - 11, 12))
    points = rig.left.rays(np.column_stack([x.ravel(), y.ravel()])) * 0.6
    right = rig.right.project(points @ rig.R.T + rig.T_right_left[:3, 3])
    left, right = rectified_points(found, rig.left.project(points), right)
    pair = plan_rectification(found).matching_pair
    seen = np.all([(side >= 0) & (side < pair.image_size) for side in (left, right)], axis=(0, 2))
    z_m = pair.focal_px * pair.baseline_m / (left - right)[seen, 0]
    assert found.errors is not None
    assert np.mean(np.abs(z_m / 0.6 - 1) > 3 * found.errors.length) < 0.05
    assert "in a tenth of the image: cover both images to their corners" in report.verdict[1]
