"""A rig or a target that changes between two photographs of a board is named, from where on, and
enters the standard errors; boards that only look so are not.
"""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from calibration_boards import photograph_board, pinhole_rig, projected_views

from calibration import StereoRig
from calibration.boards.bundle import Lens
from calibration.boards.changes import change_midway
from calibration.boards.lens import fit_rig
from calibration.boards.target_shape import target_shape
from calibration.boards.target_views import TargetView, observations_of
from calibration.boards.targets import Chessboard
from calibration.calibrate import calibrate

BOARD = Chessboard(9, 6, 0.03)
LARGER = Chessboard(9, 6, 0.0315)
BEFORE, AFTER = 9, 7


def zoomed(left: float, right: float) -> StereoRig:
    """The rig with other focal lengths."""
    rig = pinhole_rig()
    stretched = [
        replace(camera, K=camera.K * np.array([[factor, 1, 1], [1, factor, 1], [1, 1, 1]]))
        for camera, factor in ((rig.left, left), (rig.right, right))
    ]
    return replace(rig, left=stretched[0], right=stretched[1])


def turned(degrees: float) -> StereoRig:
    """The rig with the right camera turned about its vertical."""
    rig = pinhole_rig()
    T = rig.T_right_left.copy()
    T[:3, :3] = cv2.Rodrigues(np.array([0, np.radians(degrees), 0]))[0] @ T[:3, :3]
    return replace(rig, T_right_left=T)


def views_of(after: StereoRig, target: Chessboard = BOARD, seed: int = 11) -> list[TargetView]:
    """Views of the usual rig and board, then of others."""
    rng = np.random.default_rng(seed)
    second = projected_views(after, target, AFTER, 0.1, rng)
    return [
        *projected_views(pinhole_rig(), BOARD, BEFORE, 0.1, rng),
        *(replace(view, name=f"view{BEFORE + n}") for n, view in enumerate(second)),
    ]


def change_of(views: list[TargetView]) -> str | None:
    fit = fit_rig(views, BOARD, Lens("pinhole", 5))
    observations = observations_of(views, BOARD)
    shape = target_shape(fit, observations, BOARD)
    change = change_midway(fit, observations, [view.name for view in views], shape)
    return change.text if change else None


@pytest.mark.slow
@pytest.mark.parametrize(
    ("after", "target", "named"),
    [
        (zoomed(1.02, 1.0), BOARD, "the focal length of the left camera differs by +"),
        (zoomed(1.0, 1.05), BOARD, "the focal length of the right camera differs by +"),
        (zoomed(1.05, 1.05), BOARD, "the focal length of both cameras differs by +"),
        (turned(0.3), BOARD, "the cameras stand otherwise, one turned by 0."),
        (pinhole_rig(), LARGER, "the baseline differs by -"),
        (replace(turned(1.0), left=zoomed(1.03, 1.0).left), BOARD, "the views fit another rig"),
    ],
    ids=["left", "right", "both", "turned", "target", "two at once"],
)
def test_a_change_is_named_from_its_first_photograph_on(
    after: StereoRig, target: Chessboard, named: str
) -> None:
    assert str(change_of(views_of(after, target))).startswith(f"from view{BEFORE} on {named}")


@pytest.mark.slow
@pytest.mark.parametrize("sagitta_m", [0.0, 0.001])
def test_boards_from_near_to_far_or_bent_are_no_change(sagitta_m: float) -> None:
    bent = Chessboard(9, 6, 0.03)
    across = bent.points_m[:, 0] / bent.points_m[:, 0].max() - 0.5
    bent.__dict__["points_m"] = bent.points_m + np.outer(4 * sagitta_m * across**2, [0, 0, 1])
    views = projected_views(pinhole_rig(), bent, 16, 0.1, np.random.default_rng(12))
    assert change_of(views) is None
    by_size = sorted(views, key=lambda view: np.ptp(view.left.pixels[:, 0]) if view.left else 0)
    assert change_of(by_size) is None


@pytest.mark.slow
def test_stated_errors_cover_a_zoom_of_both_cameras() -> None:
    """Each half agrees with itself, and a rig between them fits both nearly as well."""
    rig = pinhole_rig()
    found, report = calibrate(views_of(zoomed(1.02, 1.02), seed=15), BOARD)
    for factor in (1.0, 1.02):
        assert abs(found.left.K[0, 0] / rig.left.K[0, 0] / factor - 1) < 2 * report.focal_std
    verdict, why = report.verdict
    assert verdict == "do it again"
    assert f"from view{BEFORE} on the focal length of both cameras" in why


@pytest.mark.slow
def test_calibrate_ends_with_exit_code_3_where_a_camera_zoomed(tmp_path: Path, cli) -> None:
    target = "chessboard:6x5:40mm"
    photograph_board(tmp_path, target)
    for side, factor in (("left", 1.04), ("right", 1.0)):
        zoom = cv2.getRotationMatrix2D((240, 180), 0, factor)
        for file in sorted((tmp_path / side).glob("*.png")):
            image = cv2.warpAffine(cv2.imread(str(file), cv2.IMREAD_GRAYSCALE), zoom, (480, 360))
            cv2.imwrite(str(file.with_name(f"1{file.name}")), image)
    sides = ("--left", tmp_path / "left", "--right", tmp_path / "right")
    code, printed, _ = cli("calibrate", "--target", target, *sides, "--out", tmp_path / "rig.yaml")
    assert code == 3, printed
    assert "suspicious: from 100 on the focal length of the left camera differs by +" in printed
    assert (tmp_path / "rig.yaml").exists()
