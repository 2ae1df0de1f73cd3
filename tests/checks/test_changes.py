"""Dives of which one rig did not take all pairs: dive commands and `check` say the same.

Both end with exit code 3.
"""

from collections.abc import Callable, Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from small_dives import write_short_reef

from calibration import Rectification
from calibration.formats import load_rig
from calibration.verification.changes import Changes
from stereo_seecolor.checks.changes import find_change
from stereo_seecolor.checks.odd_pairs import odd_among
from stereo_seecolor.commands.rig_loading import pairs_of
from stereo_seecolor.config import InputConfig
from stereo_seecolor.inputs.pairing import Pair

REEF = Path(__file__).resolve().parents[2] / "data_samples" / "reef"
NAMES = [path.stem for path in sorted((REEF / "left").iterdir())]
Picture = NDArray[np.uint8]
Alter = Callable[[int, str, Picture], Picture]


def altered(root: Path, alter: Alter, pairs: int = 12) -> tuple[Path, Path]:
    """The sample dive in half its size with each picture altered by its number and side."""
    write_short_reef(root, range(pairs))
    for side in ("left", "right"):
        for number, path in enumerate(sorted((root / side).iterdir())):
            picture = cv2.imread(str(path))
            cv2.imwrite(str(path), alter(number, side, picture))
    return root / "left", root / "right"


def enlarged(picture: Picture, factor: float, x_px: float = 0.0, y_px: float = 0.0) -> Picture:
    height, width = picture.shape[:2]
    M = cv2.getRotationMatrix2D(((width - 1) / 2, (height - 1) / 2), 0, factor)
    M[:, 2] += x_px, y_px
    return cv2.warpAffine(
        picture, M, (width, height), flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT
    )


def foreign() -> Iterator[Picture]:
    """Two views of a drawn scene by another rig: blobs on a plane, other rows and disparities."""
    rng = np.random.default_rng(8)
    small = rng.integers(20, 230, (112, 160, 3)).astype(np.uint8)
    scene = cv2.GaussianBlur(
        cv2.resize(small, (640, 448), interpolation=cv2.INTER_CUBIC), (0, 0), 1
    )
    for shift_px, down_px in ((40, 0.0), (8, 6.0)):
        M = np.array([[1, 0.01, -shift_px], [0, 1.01, down_px]], np.float64)
        yield cv2.warpAffine(scene, M, (576, 448), borderMode=cv2.BORDER_REFLECT)


def focus(number: int, side: str, picture: Picture) -> Picture:
    return enlarged(picture, 1.03) if side == "right" and number >= 7 else picture


def stabilized(number: int, side: str, picture: Picture) -> Picture:
    x_px, y_px = np.random.default_rng(number).normal(0, 3, 2)
    return enlarged(picture, 1.0, x_px, y_px) if side == "right" else picture


def opposite_shutters(number: int, side: str, picture: Picture) -> Picture:
    if side == "left":
        return picture
    y, x = np.indices(picture.shape[:2], np.float32)
    x += 2.6 * (y / len(y) - 0.5)
    return cv2.remap(picture, x, y, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("alter", "pairs", "runs", "named"),
    [
        (
            focus,
            12,
            [["--refine"]],
            [f"from {NAMES[7]} on the right images are 3.1% larger", "focus"],
        ),
        (stabilized, 6, [[]], ["change from frame to frame", "stabilization"]),
        (opposite_shutters, 6, [[], []], ["read rows in opposite directions"]),
    ],
)
def test_dive_commands_and_check_name_what_changes_and_end_with_3(
    alter: Alter, pairs: int, runs: list[list[str]], named: list[str], cli, tmp_path: Path
) -> None:
    left, right = altered(tmp_path, alter, pairs)
    words = [f"--left={left}", f"--right={right}", f"--calib={left.parent / 'cam.yaml'}"]
    made = [["range", *words, f"--out={tmp_path / 'out'}", *more] for more in runs]
    for command in (["check", *words], *made):  # the second time of frames that are there
        code, printed, said = cli(*command)
        assert code == 3, command
        assert all(text in printed + said for text in named), printed + said
        assert "ranges may be wrong by" not in printed + said


@pytest.mark.slow
def test_one_pair_of_another_rig_is_left_out_alone(cli, tmp_path: Path) -> None:
    small = (cv2.resize(view, None, fx=0.5, fy=0.5) for view in foreign())
    other = dict(zip(("left", "right"), small, strict=True))
    left, right = altered(tmp_path, lambda i, side, image: other[side] if i == 6 else image, 8)
    words = [f"--left={left}", f"--right={right}", f"--calib={left.parent / 'cam.yaml'}"]
    code, _, said = cli("range", *words, "--out", tmp_path / "out")
    assert code == 3
    assert [name for name in NAMES if f"failed: {name}" in said] == [NAMES[6]]
    assert "the following images" not in said
    assert not (tmp_path / "out" / "range" / f"{NAMES[6]}.tiff").exists()
    code, printed, _ = cli("check", *words)
    assert code == 3 and f"{NAMES[6]}: their rows do not fit the rig of the other pairs" in printed


@pytest.mark.slow
@pytest.mark.parametrize("changes", [Changes("each"), Changes("odd", odd=(3, 4, 5, 6, 7))])
def test_pairs_after_a_lost_image_are_out_of_step_and_not_stabilized(
    make_dive, monkeypatch: pytest.MonkeyPatch, changes: Changes
) -> None:
    """Where neighbors overlap, rows of such pairs differ from one to the next, and from others."""
    rows = [object()] * 3 + [None] * 5
    monkeypatch.setattr("stereo_seecolor.checks.changes.look_at_all", lambda *_: rows)
    monkeypatch.setattr("stereo_seecolor.checks.changes.changes_of", lambda _: changes)
    dive = make_dive(9)
    lefts, rights = (sorted((dive.root / side).iterdir()) for side in "LR")
    sides = zip(lefts, rights[:3] + rights[4:], strict=False)
    pairs = [Pair(left.stem, left, right) for left, right in sides]
    rig = load_rig(dive.root / "cam.yaml")
    found = find_change(Rectification.from_rig(rig), pairs, InputConfig())
    assert found.is_rigid and found.odd == {pair.name for pair in pairs[3:]}
    assert found.line.startswith(
        f"from {pairs[3].name} to {pairs[-1].name}: left and right are 1 image out of synchro"
    )


@pytest.mark.slow
@pytest.mark.parametrize("swapped", [range(8, 12), range(2)])
def test_exchanged_pairs_are_named_once(swapped: range, tmp_path: Path) -> None:
    own = pairs_of(REEF / "left", REEF / "right", InputConfig()).pairs
    pairs = [
        Pair(pair.name, pair.right, pair.left) if i in swapped else pair
        for i, pair in enumerate(own)
    ]
    rig = load_rig(REEF / "cam.yaml")
    found = find_change(Rectification.from_rig(rig), pairs, InputConfig())
    first, last = pairs[swapped[0]].name, pairs[swapped[-1]].name
    assert f"from {first} to {last}: left and right are exchanged" in found.line
    assert found.odd == {pairs[i].name for i in swapped} and found.is_rigid


@pytest.mark.slow
def test_an_odd_pair_between_those_that_are_compared_is_found_by_its_numbers(
    tmp_path: Path,
) -> None:
    pairs = list(pairs_of(REEF / "left", REEF / "right", InputConfig()).pairs)
    other = (tmp_path / "left.png", tmp_path / "right.png")
    for path, view in zip(other, foreign(), strict=True):
        cv2.imwrite(str(path), view)
    pairs[6] = Pair(pairs[6].name, *other)
    rectification = Rectification.from_rig(load_rig(REEF / "cam.yaml"))
    usual = {"coverage": 0.9, "median_range_m": 2.0}
    facts = [usual] * 6 + [{"coverage": 0.5, "median_range_m": 1.2}] + [usual] * 5
    assert odd_among(rectification, pairs, InputConfig(), facts).odd == {NAMES[6]}
    assert not odd_among(rectification, pairs, InputConfig(), [usual] * 12).odd
    facts[3] = {"coverage": 0.4}  # of the dive's rig, whatever its numbers
    assert odd_among(rectification, pairs, InputConfig(), facts).odd == {NAMES[6]}
    assert odd_among(rectification, pairs[:0], InputConfig(), []).odd == frozenset()


@pytest.mark.slow
def test_the_sample_dive_is_of_one_rig() -> None:
    rig = load_rig(REEF / "cam.yaml")
    pairs = pairs_of(REEF / "left", REEF / "right", InputConfig()).pairs
    assert find_change(Rectification.from_rig(rig), pairs, InputConfig()).line == ""
