"""Usual mistakes with a calibration: each is named by points of both images, and none where the rig
is right or has moved.
"""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from calibration_boards import fisheye_rig, pinhole_rig

from calibration import Rectification, StereoRig
from calibration.resizing import wrong_size
from calibration.verification import mistakes
from calibration.verification.matches import Matches
from calibration.verification.mistakes import likely_mistake

IMAGES = (np.zeros((960, 1280), np.uint8), np.zeros((960, 1280), np.uint8))


def verged_rig() -> StereoRig:
    """Whose cameras look towards each other, with lenses that are not alike, as real rigs'."""
    rig = pinhole_rig()
    T = rig.T_right_left.copy()
    T[:3, :3] = cv2.Rodrigues(np.array([0.004, 0.01, -0.003]))[0]
    K = rig.right.K.copy()
    K[:2, 2] += [14.0, -17.0]
    return replace(rig, right=replace(rig.right, K=K), T_right_left=T)


def points_of(rig: StereoRig, noise_px: float = 0.5) -> Matches:
    """Of both raw images, 0.8 to 4 m away; a tenth are mismatched."""
    rng = np.random.default_rng(1)
    size = np.array(rig.left.image_size)
    points = rig.left.rays(rng.uniform([0, 0], size - 1, (500, 2))) * rng.uniform(0.8, 4, (500, 1))
    left, right = (
        rig.left.project(points),
        rig.right.project(points @ rig.R.T + rig.T_right_left[:3, 3]),
    )
    right[::10] += rng.normal(0, 60, right[::10].shape)
    return Matches(
        left + rng.normal(0, noise_px, left.shape), right + rng.normal(0, noise_px, right.shape)
    )


def changed(rig: StereoRig, R: np.ndarray, t: np.ndarray) -> StereoRig:
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = R, t
    return replace(rig, T_right_left=T)


def inverse(rig: StereoRig) -> StereoRig:
    return changed(rig, rig.R.T, -rig.R.T @ rig.T_right_left[:3, 3])


def exchanged(rig: StereoRig) -> StereoRig:
    return replace(inverse(rig), left=rig.right, right=rig.left)


MISTAKES = {
    "left and right look swapped": exchanged,
    "the inverse one": inverse,
    "rotation between the cameras is transposed": lambda rig: changed(
        rig, rig.R.T, rig.T_right_left[:3, 3]
    ),
    "points the wrong way": lambda rig: changed(rig, rig.R, -rig.T_right_left[:3, 3]),
    "-R T if it is the position of the right camera": lambda rig: changed(
        rig, rig.R, -rig.R.T @ rig.T_right_left[:3, 3]
    ),
    "lenses of left and right are exchanged": lambda rig: replace(
        rig, left=rig.right, right=rig.left
    ),
}


@pytest.mark.parametrize("what", MISTAKES)
def test_a_mistake_in_the_calibration_is_named(what: str, monkeypatch: pytest.MonkeyPatch) -> None:
    rig = verged_rig()
    monkeypatch.setattr(mistakes, "similar_points", lambda *_: points_of(rig))
    found = likely_mistake(MISTAKES[what](rig), [IMAGES])
    assert found is not None
    assert what in found.line
    assert found.exchanged == ("swapped" in what)
    assert np.allclose(found.rig.T_right_left, rig.T_right_left, atol=5e-3)


def test_images_that_are_rectified_already_are_named(monkeypatch: pytest.MonkeyPatch) -> None:
    rig = verged_rig()
    rig = changed(rig, cv2.Rodrigues(np.array([0.05, 0.02, 0.06]))[0], rig.T_right_left[:3, 3])
    points = points_of(Rectification.from_rig(rig).rectified_rig())
    monkeypatch.setattr(mistakes, "similar_points", lambda *_: points)
    found = likely_mistake(rig, [IMAGES])
    assert found is not None
    assert (
        "the images are rectified already" in found.line
        and "give the calibration of the rectified images" in found.line
    )


@pytest.mark.parametrize("sides", [("left",), ("right",), ("left", "right")])
def test_images_that_were_turned_are_named(
    sides: tuple[str, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    rig = verged_rig()
    points = points_of(rig)
    turned = Matches(
        *(
            np.array([1279, 959]) - getattr(points, s) if s in sides else getattr(points, s)
            for s in ("left", "right")
        )
    )
    monkeypatch.setattr(mistakes, "similar_points", lambda *_: turned)
    found = likely_mistake(rig, [IMAGES])
    assert found is not None
    assert f"the {' and '.join(sides)} images are rotated by 180 degrees" in found.line


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("sides", [("left",), ("right",), ("left", "right")])
def test_images_that_were_mirrored_are_named(
    axis: int, sides: tuple[str, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of one side alone mirrored nothing looks alike, until the right images are."""
    rig = verged_rig()
    rig = changed(rig, cv2.Rodrigues(np.array([0.02, 0.01, -0.003]))[0], rig.T_right_left[:3, 3])
    pixels = {side: getattr(points_of(rig), side) for side in ("left", "right")}
    for side in sides:
        pixels[side][:, axis] = (1279, 959)[axis] - pixels[side][:, axis]
    images = (IMAGES[0], IMAGES[1].copy())
    images[1][0, -1] = 1  # the corner that is at the left once the images are mirrored

    def similar_points(_: np.ndarray, right: np.ndarray) -> Matches:
        if len(sides) == 2:
            return Matches(pixels["left"], pixels["right"])
        if right[0, 0] == 0:
            return Matches(np.zeros((0, 2)), np.zeros((0, 2)))
        return Matches(pixels["left"], np.abs([1279, 0] - pixels["right"]))

    monkeypatch.setattr(mistakes, "similar_points", similar_points)
    found = likely_mistake(rig, [images])
    assert found is not None
    assert (
        f"the {' and '.join(sides)} images are mirrored, "
        f"{('left to right', 'top to bottom')[axis]}," in found.line
    )


@pytest.mark.parametrize(
    "rig", [pinhole_rig(), verged_rig(), fisheye_rig(), exchanged(verged_rig())]
)
def test_a_rig_that_is_right_is_not_accused(
    rig: StereoRig, monkeypatch: pytest.MonkeyPatch
) -> None:
    size = rig.left.image_size[::-1]
    monkeypatch.setattr(mistakes, "similar_points", lambda *_: points_of(rig))
    assert likely_mistake(rig, [(np.zeros(size, np.uint8), np.zeros(size, np.uint8))]) is None


@pytest.mark.parametrize("turn_px", [1.0, 4.0, 15.0])
def test_a_camera_that_has_moved_is_no_mistake(
    turn_px: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    rig = verged_rig()
    turned = cv2.Rodrigues(np.array([turn_px / rig.left.K[0, 0], 0.0, 0.001]))[0] @ rig.R
    monkeypatch.setattr(mistakes, "similar_points", lambda *_: points_of(rig))
    assert likely_mistake(changed(rig, turned, rig.T_right_left[:3, 3]), [IMAGES]) is None


@pytest.mark.parametrize("pitch_px", [-8.0, -4.0, 1.5])
def test_an_inverse_transform_of_a_rig_that_moved_gets_no_other_name(
    pitch_px: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    rig = verged_rig()
    turned = cv2.Rodrigues(np.array([pitch_px / rig.left.K[0, 0], 0.0, 0.001]))[0] @ rig.R
    given = inverse(changed(rig, turned, rig.T_right_left[:3, 3]))
    monkeypatch.setattr(mistakes, "similar_points", lambda *_: points_of(rig, 0.2))
    found = likely_mistake(given, [IMAGES])
    assert found is None or "the inverse" in found.line


def test_swapped_sides_of_alike_lenses_may_be_mirrored_images(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    camera = replace(
        pinhole_rig().left,
        K=np.array([[900.0, 0, 639.5], [0, 900, 479.5], [0, 0, 1]]),
        distortion=np.zeros(5),
    )
    rig = changed(
        replace(pinhole_rig(), left=camera, right=camera), np.eye(3), np.array([-0.1, 0, 0])
    )
    monkeypatch.setattr(mistakes, "similar_points", lambda *_: points_of(exchanged(rig)))
    found = likely_mistake(rig, [IMAGES])
    assert found is not None
    assert found.exchanged
    assert "images mirrored on both sides would look the same" in found.line


def test_two_images_of_different_things_tell_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(3)
    strewn = Matches(rng.uniform(0, 960, (200, 2)), rng.uniform(0, 960, (200, 2)))
    monkeypatch.setattr(mistakes, "similar_points", lambda *_: strewn)
    assert likely_mistake(inverse(verged_rig()), [IMAGES]) is None
    # another size: what is wrong is said elsewhere
    assert likely_mistake(verged_rig(), [(IMAGES[0][::2], IMAGES[1])]) is None


@pytest.mark.parametrize(
    ("size", "said"),
    [
        ((960, 1280), "rotated by 90 degrees: rotate them back"),
        ((2560, 960), "both sides lay side by side in it: give it as --left and as --right"),
        ((1280, 1920), "one above the other: give it as --left and as --right"),
        ((640, 1920), "one above the other: give it as --left and as --right"),
        ((640, 960), "as if each side were squeezed: stretch both sides"),
        ((1280, 720), "a crop or another camera"),
    ],
)
def test_what_images_of_another_shape_may_be(size: tuple[int, int], said: str) -> None:
    assert said in wrong_size("left", size, (1280, 960))
