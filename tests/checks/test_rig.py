"""What ``run`` says of a calibration before it starts: the same as ``check``."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from small_dives import write_short_reef

from calibration import StereoRig
from calibration.formats import load_rig
from stereo_seecolor.checks.changes import DiveChange
from stereo_seecolor.checks.rig import check_rig
from stereo_seecolor.checks.verdict import RANGES
from stereo_seecolor.commands.rig_loading import pairs_of
from stereo_seecolor.config import RunConfig
from stereo_seecolor.pipeline import Pipeline

REEF = Path(__file__).resolve().parents[2] / "data_samples" / "reef"


def lowered(rig: StereoRig, by_px: float) -> StereoRig:
    """The rig with the right camera's center lower than it is."""
    K = rig.right.K.copy()
    K[1, 2] += by_px
    return replace(rig, right=replace(rig.right, K=K))


@pytest.mark.slow
@pytest.mark.parametrize(("by_px", "said"), [(0.0, False), (0.35, True)])
def test_a_run_names_rows_that_check_would_not_accept(by_px: float, said: bool) -> None:
    pairs = pairs_of(REEF / "left", REEF / "right", RunConfig().input).pairs[:5]
    notes = check_rig(
        Pipeline(lowered(load_rig(REEF / "cam.yaml"), by_px), RunConfig()), pairs, DiveChange()
    ).notes
    assert (
        any("a vertical disparity of 0.3" in note and "run --refine" in note for note in notes)
        == said
    )
    assert bool(notes) == said


@pytest.mark.slow
def test_a_run_names_a_stretch_that_motion_alone_leaves_open(tmp_path: Path) -> None:
    """Images 1.1 times as wide as they were taken: the motion wants ranges 4 +- 4 % longer."""
    for image in sorted(REEF.glob("*t/*.png")):
        seen = cv2.imread(str(image))
        height, width = seen.shape[:2]
        wider = np.array([[1.1, 0, -0.05 * (width - 1)], [0, 1, 0]])
        (tmp_path / image.parent.name).mkdir(exist_ok=True)
        wide = cv2.warpAffine(
            seen, wider, (width, height), flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT
        )
        cv2.imwrite(str(tmp_path / image.parent.name / image.name), wide)
    pairs = pairs_of(tmp_path / "left", tmp_path / "right", RunConfig().input).pairs
    rig = load_rig(REEF / "cam.yaml")
    found = check_rig(Pipeline(rig, RunConfig()), pairs, DiveChange())
    assert found.wrong == RANGES
    assert any("stretched 1.10 " in note and "in width" in note for note in found.notes)


@pytest.mark.slow
def test_a_run_refuses_rectified_images_with_the_raw_calibration(cli, tmp_path: Path) -> None:
    """Ranges would be wrong by a third, and the rows can be refined until they agree."""
    write_short_reef(tmp_path, range(3))
    calib = tmp_path / "cam.yaml"
    words = [f"--{side}={tmp_path / side}" for side in ("left", "right")]
    assert cli("rectify", *words, "--calib", calib, "--out", tmp_path / "flat")[0] == 0
    sides = [f"--{side}={tmp_path / 'flat' / f'rectified_{side}'}" for side in ("left", "right")]
    for more in ((), ("--refine",)):
        code, _, said = cli("run", *sides, "--calib", calib, "--out", tmp_path / "out", *more)
        assert code == 1
        assert "the images are rectified already" in said.splitlines()[-1]
    code, printed, _ = cli(
        "inspect",
        tmp_path / "flat" / "rectified_left",
        tmp_path / "flat" / "rectified_right",
        calib,
    )
    assert code == 3
    assert (
        "the images are rectified already" in printed
        and "--calib CALIBRATION" in printed
        and "flat_port" not in printed
    )


@pytest.mark.slow
def test_one_cameras_pictures_on_both_sides_are_refused(cli, tmp_path: Path) -> None:
    write_short_reef(tmp_path, range(3))
    for image in (tmp_path / "left").iterdir():
        encoded = cv2.imencode(".jpg", cv2.imread(str(image)), [cv2.IMWRITE_JPEG_QUALITY, 80])[1]
        cv2.imwrite(str(tmp_path / "right" / image.name), cv2.imdecode(encoded, 1))
    words = [f"--{side}={tmp_path / side}" for side in ("left", "right")] + [
        "--calib",
        str(tmp_path / "cam.yaml"),
    ]
    for command, expected in (
        (["run", *words, "--out", str(tmp_path / "out")], 1),
        (["check", *words], 3),
    ):
        code, printed, said = cli(*command)
        assert code == expected
        assert "both sides show one camera's image" in printed + said
    sides = (tmp_path / "left", tmp_path / "right")
    assert cli("inspect", *sides, tmp_path / "cam.yaml")[0] == 3


@pytest.mark.slow
@pytest.mark.parametrize("brightness", [1.0, 0.12])
def test_an_unrelated_pair_is_no_pair_for_inspect(brightness: float, cli, tmp_path: Path) -> None:
    for side, number in (("left", 0), ("right", 8)):
        (tmp_path / side).mkdir()
        pixels = cv2.imread(str(sorted((REEF / side).iterdir())[number])) * brightness
        cv2.imwrite(str(tmp_path / side / "0001.png"), pixels.astype(np.uint8))
    code, printed, _ = cli("inspect", tmp_path / "left", tmp_path / "right", REEF / "cam.yaml")
    assert code == 3
    assert "no sample pair shows one scene" in printed
