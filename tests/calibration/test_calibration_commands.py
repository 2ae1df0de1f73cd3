"""The commands around a calibration, as a user types them."""

from pathlib import Path

import av
import cv2
import numpy as np
import pytest
from calibration_boards import photograph_board, rendered
from calibration_texts import OPENCV, OPENCV_EXTRINSICS, OPENCV_INTRINSICS, ROS_LEFT, ROS_RIGHT
from conftest import Cli

from calibration import StereoRig
from calibration.formats import load_rig, write_rig

TARGET = "chessboard:7x5:40mm"


@pytest.fixture(scope="module")
def board_pairs(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, StereoRig]:
    """A folder of six rendered pairs of a board, in left/ and right/, and the rig that took
    them.
    """
    folder = tmp_path_factory.mktemp("boards")
    rig = photograph_board(folder, TARGET)
    return folder, rig


@pytest.mark.slow
def test_check_and_calibrate_take_videos(
    cli: Cli, board_pairs: tuple[Path, StereoRig], tmp_path: Path
) -> None:
    folder, rig = board_pairs
    write_rig(rig, tmp_path / "true.yaml")
    both = tmp_path / "both.mkv"
    names = sorted(path.name for path in (folder / "left").iterdir())
    images = [
        np.hstack([cv2.imread(str(folder / side / name)) for side in ("left", "right")])
        for name in names
    ]
    with av.open(str(both), "w") as video:
        stream = video.add_stream("ffv1", rate=5)
        stream.pix_fmt = "bgr0"
        stream.height, stream.width = images[0].shape[:2]
        for image in images:
            video.mux(stream.encode(av.VideoFrame.from_ndarray(image, format="bgr24")))
        video.mux(stream.encode())
    code, said, _ = cli("check", "--left", both, "--right", both, "--calib", tmp_path / "true.yaml")
    assert code == 0 and "points in 6 pairs: vertical disparity 0.0" in said
    code, _, said = cli(
        "calibrate",
        "--left",
        both,
        "--right",
        both,
        "--target",
        TARGET,
        "--out",
        tmp_path / "cam.yaml",
    )
    assert code == 0, said
    assert load_rig(tmp_path / "cam.yaml").baseline_m == pytest.approx(rig.baseline_m, rel=0.01)


@pytest.mark.slow
def test_calibrate_from_folders(
    cli: Cli, board_pairs: tuple[Path, StereoRig], tmp_path: Path
) -> None:
    folder, rig = board_pairs
    out = tmp_path / "cam.yaml"
    code, printed, said = cli(
        "calibrate",
        "--left",
        folder / "left",
        "--right",
        folder / "right",
        "--target",
        TARGET,
        "--out",
        out,
    )
    assert code == 0, said
    found = load_rig(out)
    assert found.baseline_m == pytest.approx(rig.baseline_m, rel=0.01)
    assert found.left.K[0, 0] == pytest.approx(rig.left.K[0, 0], rel=0.01)
    assert found.medium == "water"
    assert "6 of 6 views used" in printed
    assert printed.strip().splitlines()[-3].startswith(("good", "usable", "do it again"))
    assert (tmp_path / "cam_coverage.png").stat().st_size > 1000


@pytest.mark.slow
def test_calibration_that_must_be_done_again_gives_exit_code_3(
    cli: Cli, board_pairs: tuple[Path, StereoRig], tmp_path: Path
) -> None:
    for side in ("left", "right"):
        (tmp_path / side).mkdir()
        for path in sorted((board_pairs[0] / side).iterdir())[:4]:
            (tmp_path / side / path.name).symlink_to(path)
    sides = ("--left", tmp_path / "left", "--right", tmp_path / "right")
    code, printed, _ = cli("calibrate", "--target", TARGET, *sides, "--out", tmp_path / "cam.yaml")
    assert "do it again: corners in only" in printed
    assert code == 3
    assert (tmp_path / "cam.yaml").exists()


def test_calibrate_prints_the_target(cli: Cli, tmp_path: Path) -> None:
    code, printed, _ = cli(
        "calibrate", "--target", TARGET, "--print-target", tmp_path / "board.pdf"
    )
    assert code == 0
    assert "print it at 100 %" in printed
    assert (tmp_path / "board.pdf").read_bytes().startswith(b"%PDF")


def test_calibrate_without_folders_is_wrong_usage(cli: Cli) -> None:
    code, _, said = cli("calibrate", "--target", TARGET)
    assert code == 2
    assert "--left" in said


@pytest.mark.slow
def test_target_that_is_not_there(
    cli: Cli, board_pairs: tuple[Path, StereoRig], tmp_path: Path
) -> None:
    folder, _ = board_pairs
    words = (
        "--left",
        folder / "left",
        "--right",
        folder / "right",
        "--target",
        "chessboard:8x5:40mm",
        "--out",
        tmp_path / "cam.yaml",
    )
    code, _, said = cli("calibrate", *words)
    assert code == 1
    assert "0 of 6 pairs" in said and said.count("stereo-seecolor: ") == 1
    assert not (tmp_path / "cam.yaml").exists()
    code, _, said = cli("calibrate", *words[:3], folder / "left", *words[4:])
    assert code == 1
    assert f"each image was cut in two, since {folder / 'left'} is given as both sides" in said


@pytest.mark.slow
def test_check_tells_a_good_calibration_from_a_bad_one(
    cli: Cli, board_pairs: tuple[Path, StereoRig], tmp_path: Path
) -> None:
    _, rig = board_pairs
    write_rig(rig, tmp_path / "cam.yaml")
    folders = ("--left", tmp_path / "left", "--right", tmp_path / "right")
    sand = cv2.GaussianBlur(
        np.random.default_rng(0).integers(0, 256, (500, 700), dtype=np.uint8), (0, 0), 1.5
    )
    sand = cv2.normalize(sand, None, 0, 255, cv2.NORM_MINMAX)
    pose = np.eye(4)
    pose[2, 3] = 0.7
    for side, camera, extrinsic in (
        ("left", rig.left, np.eye(4)),
        ("right", rig.right, rig.T_right_left),
    ):
        (tmp_path / side).mkdir()
        cv2.imwrite(
            str(tmp_path / side / "0.png"),
            rendered(camera, extrinsic @ pose, sand, 700, np.array([-0.5, -0.36])),
        )
    code, printed, _ = cli("check", *folders, "--calib", tmp_path / "cam.yaml")
    assert code == 0
    assert "baseline 100.0 mm" in printed
    assert "is acceptable" in printed
    turned = rig.T_right_left.copy()
    turned[:3, :3] = cv2.Rodrigues(np.array([0.004, 0.0, 0.0]))[0]
    write_rig(StereoRig(rig.left, rig.right, turned), tmp_path / "turned.yaml")
    code, printed, _ = cli("check", *folders, "--calib", tmp_path / "turned.yaml")
    assert code == 0  # ranges are right
    assert "a camera has moved since" in printed
    assert "NOT acceptable" in printed and "rows alone" in printed


def test_check_reads_images_as_the_settings_say(cli: Cli, tmp_path: Path) -> None:
    for side in ("left", "right"):
        (tmp_path / side).mkdir()
        cv2.imwrite(str(tmp_path / side / "0.png"), np.full((40, 60), 60_000, np.uint16))
    folders = (
        "--left",
        tmp_path / "left",
        "--right",
        tmp_path / "right",
        "--calib",
        tmp_path / "cam.yaml",
    )
    code, _, said = cli("check", *folders, "--set", "input.significant_bits=12")
    assert code == 1
    assert "12" in said and "0.png" in said


def test_convert(cli: Cli, tmp_path: Path) -> None:
    (tmp_path / "left.yaml").write_text(ROS_LEFT)
    (tmp_path / "right.yaml").write_text(ROS_RIGHT)
    assert cli("convert-calib", tmp_path, tmp_path / "stereo.yml", "--to", "opencv")[0] == 0
    assert cli("convert-calib", tmp_path / "stereo.yml", tmp_path / "again", "--to", "ros")[0] == 0
    np.testing.assert_allclose(
        load_rig(tmp_path / "again").T_right_left,
        load_rig(tmp_path / "stereo.yml").T_right_left,
        atol=1e-12,
    )


def test_a_calibration_goes_into_a_new_folder_and_not_onto_one(cli: Cli, tmp_path: Path) -> None:
    (tmp_path / "left.yaml").write_text(ROS_LEFT)
    (tmp_path / "right.yaml").write_text(ROS_RIGHT)
    assert cli("convert-calib", tmp_path, tmp_path / "new/deep/cam.yaml")[0] == 0
    code, _, said = cli("convert-calib", tmp_path / "new/deep/cam.yaml", tmp_path / "new")
    assert code == 1
    assert "new: already exists" in said


def test_a_target_goes_into_a_new_folder_and_not_below_a_file(cli: Cli, tmp_path: Path) -> None:
    assert (
        cli("calibrate", "--target", TARGET, "--print-target", tmp_path / "new/target.pdf")[0] == 0
    )
    code, _, said = cli(
        "calibrate", "--target", TARGET, "--print-target", tmp_path / "new/target.pdf/again.pdf"
    )
    assert code == 1
    assert "again.pdf: cannot be written: " in said
    assert said.count("\n") == 1


def test_convert_from_opencv_needs_the_size(cli: Cli, tmp_path: Path) -> None:
    (tmp_path / "intrinsics.yml").write_text(OPENCV_INTRINSICS)
    (tmp_path / "extrinsics.yml").write_text(OPENCV_EXTRINSICS)
    source = f"{tmp_path}/intrinsics.yml,{tmp_path}/extrinsics.yml"
    assert cli("convert-calib", source, tmp_path / "cam.yaml")[0] == 1
    assert cli("convert-calib", source, tmp_path / "cam.yaml", "--size", "640x480")[0] == 0
    four = OPENCV.replace(", 1.6e-01 ]", " ]").replace(", -7e-3 ]", " ]")
    (tmp_path / "four.yml").write_text(four)
    code, printed, _ = cli(
        "convert-calib", tmp_path / "four.yml", tmp_path / "from_four.yaml", "--size", "640x480"
    )
    assert code == 3
    assert (
        "note: 4 coefficients as OpenCV's k1 k2 p1 p2: used, but the file can be read in 2 ways"
        in printed
    )
    assert printed.endswith("--refine refined.yaml'; then convert refined.yaml\n")
    code, _, said = cli("convert-calib", source, tmp_path / "wide.yaml", "--size", "wide")
    assert code == 1 and "expected WIDTHxHEIGHT" in said


@pytest.mark.slow
def test_convert_refuses_words_that_contradict_each_other(
    cli: Cli, tmp_path: Path, board_pairs: tuple[Path, StereoRig]
) -> None:
    """Another size than the file's, one name for two files, and another format's ending."""
    source = tmp_path / "rig.yaml"
    write_rig(board_pairs[1], source)
    one = tmp_path / "one.yaml"
    for out, words, message in (
        (tmp_path / "cam.yaml", ("--size", "1280x960"), "states images of 480x360 px"),
        (f"{one},{one}", ("--to", "ros"), "give two names"),
        (tmp_path / "cam.mat", (), "the native format ends in .yaml"),
        (tmp_path / "cam.yaml", ("--to", "matlab"), "the matlab format ends in .mat"),
    ):
        code, _, said = cli("convert-calib", source, out, *words)
        assert code == 1
        assert message in said
    assert [path.name for path in tmp_path.iterdir()] == ["rig.yaml"]
    assert cli("convert-calib", source, tmp_path / "cam.yaml", "--size", "480x360")[0] == 0


@pytest.mark.slow
def test_check_refines_a_rig_that_has_moved(
    cli: Cli, board_pairs: tuple[Path, StereoRig], tmp_path: Path
) -> None:
    _, rig = board_pairs
    rng = np.random.default_rng(0)
    for number in range(3):
        sand = cv2.GaussianBlur(rng.integers(0, 256, (500, 700), dtype=np.uint8), (0, 0), 1.5)
        sand = cv2.normalize(sand, None, 0, 255, cv2.NORM_MINMAX)
        pose = np.eye(4)
        pose[2, 3] = 0.65 + 0.05 * number
        for side, camera, extrinsic in (
            ("left", rig.left, np.eye(4)),
            ("right", rig.right, rig.T_right_left),
        ):
            (tmp_path / side).mkdir(exist_ok=True)
            picture = rendered(camera, extrinsic @ pose, sand, 700, np.array([-0.5, -0.36]))
            cv2.imwrite(str(tmp_path / side / f"{number}.png"), picture)
    turned = np.eye(4)
    turned[:3, :3] = cv2.Rodrigues(np.array([0.002, 0.0, 0.0]))[0]
    write_rig(StereoRig(rig.left, rig.right, turned @ rig.T_right_left), tmp_path / "cam.yaml")
    folders = ("--left", tmp_path / "left", "--right", tmp_path / "right")
    code, printed, _ = cli(
        "check", *folders, "--calib", tmp_path / "cam.yaml", "--refine", tmp_path / "refined.yaml"
    )
    assert code == 0
    assert "NOT acceptable" in printed and "refined.yaml: the refined calibration" in printed
    (verdict,) = (line for line in printed.splitlines() if "NOT acceptable" in line)
    assert "run --refine" in verdict
    code, printed, _ = cli("check", *folders, "--calib", tmp_path / "refined.yaml", "--json")
    assert code == 0
    assert '"refined": null' in printed


@pytest.mark.parametrize(
    ("words", "file"),
    [
        (("calibrate", "--left", "l", "--right", "r", "--target", TARGET, "--out"), "cam.yaml"),
        (("calibrate", "--target", TARGET, "--print-target"), "board.pdf"),
        (("convert-calib", "given.yaml"), "cam.yaml"),
        (("convert-calib", "given.yaml", "--to", "ros"), "left.yaml,right.yaml"),
        (("check", "--left", "l", "--right", "r", "--calib", "given.yaml", "--refine"), "cam.yaml"),
        (("evaluate", "--chart", "--images", "l", "--range", "r", "--sheet"), "charts.png"),
    ],
)
def test_a_file_of_the_user_is_not_written_over(
    cli: Cli, tmp_path: Path, monkeypatch, words: tuple[str, ...], file: str
) -> None:
    monkeypatch.chdir(tmp_path)
    theirs = tmp_path / file.split(",")[-1]
    theirs.write_bytes(b"the only calibration of a rig that is lost")
    code, _, said = cli(*words, file)
    assert (
        code == 1
        and f"{theirs.name}: already exists, and is not overwritten" in said
        and said.count("\n") == 1
    )
    assert [path.name for path in tmp_path.iterdir()] == [theirs.name]
    assert theirs.read_bytes() == b"the only calibration of a rig that is lost"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("target", "axes", "named"),
    [
        ("chessboard:8x6:40mm", (), "the images show a chessboard of 7x5 inner corners, not 8x6"),
        (TARGET, (1,), "the images of one side are mirrored"),
        (TARGET, (0, 1), "the images of one side are turned by 180 degrees"),
    ],
)
def test_calibrate_names_what_the_images_show_instead(
    cli: Cli,
    board_pairs: tuple[Path, StereoRig],
    tmp_path: Path,
    target: str,
    axes: tuple[int, ...],
    named: str,
) -> None:
    """Squares counted in place of corners, and one camera that mirrors or stands upside down."""
    folder, _ = board_pairs
    (tmp_path / "right").mkdir()
    for image in (folder / "right").iterdir():
        changed = np.flip(cv2.imread(str(image)), axes)
        cv2.imwrite(str(tmp_path / "right" / image.name), changed)
    sides = ("--left", folder / "left", "--right", tmp_path / "right")
    out = tmp_path / "cam.yaml"
    code, _, said = cli("calibrate", *sides, "--target", target, "--out", out)
    assert code == 1
    assert named in said
    assert not out.exists()
