"""Two videos without a wire: offset and drift against known truth, and refusals."""

import hashlib
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from video_writers import HEIGHT, RATE_HZ, WIDTH, swell, write_pair

from calibration import Camera, StereoRig
from calibration.formats import write_rig
from stereo_seecolor.config import InputConfig
from stereo_seecolor.errors import DeviceError, InputError
from stereo_seecolor.extras.streams.videos import choice as choice_of_frames
from stereo_seecolor.extras.streams.videos import synchronization
from stereo_seecolor.extras.streams.videos.agreement import unlike
from stereo_seecolor.extras.streams.videos.choice import choose_frames
from stereo_seecolor.extras.streams.videos.lags import Lag, straight_lag
from stereo_seecolor.extras.streams.videos.motion import VideoSignals, video_signals
from stereo_seecolor.extras.streams.videos.pairs import Videos
from stereo_seecolor.extras.streams.videos.row_lag import row_lag, solve_shift
from stereo_seecolor.extras.streams.videos.sync import sync
from stereo_seecolor.extras.streams.videos.synchronization import paired

KNOWN_SIGNALS: dict[str, VideoSignals] = {}


@pytest.fixture(autouse=True, scope="module")
def signals_once() -> Iterator[None]:
    """The signals of a video are found once, however many tests have a copy of it."""

    def known_signals(path: Path) -> VideoSignals:
        if not path.is_file():
            return video_signals(path)
        content = hashlib.sha256(path.read_bytes()).hexdigest()
        if content not in KNOWN_SIGNALS:
            KNOWN_SIGNALS[content] = video_signals(path)
        return KNOWN_SIGNALS[content]

    with pytest.MonkeyPatch.context() as patch:
        for module in (synchronization, choice_of_frames):
            patch.setattr(module, "video_signals", known_signals)
        yield


def error_s(found, offset_s: float, drift: float) -> float:
    """Of the right clock, at the middle of the overlap."""
    return found.offset_s - offset_s - drift * found.center_s


@pytest.mark.slow
@pytest.mark.parametrize("tenths_of_a_frame", [0, 5, 8, 137, 451, -124])
def test_offsets_are_found_from_motion_alone(tenths_of_a_frame: int, tmp_path: Path) -> None:
    offset_s = tenths_of_a_frame / 10 / RATE_HZ
    found = sync(*write_pair(tmp_path, offset_s))
    error = abs(error_s(found, offset_s, 0.0))
    assert error < 0.002
    assert error < 3 * found.std_s
    assert [item.kind for item in found.evidence] == ["motion"]


@pytest.mark.slow
def test_drift_is_found_in_a_longer_video(tmp_path: Path) -> None:
    drift = 50e-6
    found = sync(*write_pair(tmp_path, 0.71, drift, seconds=60))
    assert abs(found.drift - drift) < 3 * found.drift_std < 90e-6
    assert abs(error_s(found, 0.71, drift)) < min(0.002, 3 * found.std_s)


@pytest.mark.slow
def test_sound_alone_is_enough(tmp_path: Path) -> None:
    found = sync(*write_pair(tmp_path, 0.3217, seconds=10, moves=False, sound=True))
    assert [item.kind for item in found.evidence] == ["sound"]
    assert abs(error_s(found, 0.3217, 0.0)) < min(0.001, 3 * found.std_s)


@pytest.mark.slow
def test_a_flash_alone_is_enough_for_the_nearest_frame(tmp_path: Path) -> None:
    found = sync(*write_pair(tmp_path, 0.72, moves=False, flash_s=3.0))
    assert [item.kind for item in found.evidence] == ["flash"]
    assert abs(error_s(found, 0.72, 0.0)) < 1 / RATE_HZ


@pytest.mark.slow
@pytest.mark.parametrize(
    ("suffix", "codes", "offset_s"),
    [
        (".mp4", ("10:00:01:12", "10:00:00:00"), 1.4),
        (".mov", ("23:59:59:29", "00:00:00:02"), -0.1),  # over midnight
        (".mkv", ("00:01:00;02", "00:00:59;29"), 1 / 30),  # two numbers are dropped between
        (".mov", ("00:10:00;00", "00:09:59;28"), 2 / 30),  # and none in each tenth minute
    ],
)
def test_time_codes_alone_are_enough(
    tmp_path: Path, suffix: str, codes: tuple[str, str], offset_s: float
) -> None:
    found = sync(
        *write_pair(tmp_path, offset_s, seconds=3, moves=False, time_codes=codes, suffix=suffix)
    )
    assert [item.kind for item in found.evidence] == ["time code"]
    assert found.offset_s == pytest.approx(offset_s, abs=1e-6)
    assert found.std_s == pytest.approx(np.sqrt(2 / 12) / RATE_HZ, rel=1e-6)


@pytest.mark.slow
def test_time_codes_that_were_not_set_alike_are_not_used(tmp_path: Path) -> None:
    left, right = write_pair(tmp_path, 0.2, time_codes=("10:00:07:00", "10:00:00:00"))
    found = sync(left, right)
    assert [item.kind for item in found.evidence] == ["motion"]
    assert "time codes say +7.000 s, so they were not synchronized, and are not used" in found.text
    _, alike = write_pair(tmp_path / "alike", 0.2, time_codes=("10:00:07:00", "10:00:06:24"))
    assert [item.kind for item in sync(left, alike).evidence] == ["motion", "time code"]
    with pytest.raises(InputError, match="was given for both sides"):
        sync(left, left)


@pytest.mark.slow
def test_motion_sound_and_flash_agree(tmp_path: Path, cli) -> None:
    left, right = write_pair(tmp_path / "dive 1", -0.4, seconds=10, sound=True, flash_s=4.0)
    code, printed, said = cli("sync", left, right)
    assert code == 0, said
    for word in (
        "from motion and sound and flash",
        "motion: -0.",
        "pairs of frames",
        f"run --left '{left}'",
    ):
        assert word in printed
    assert sync(left, right).pairs == pytest.approx(300 - 12, abs=2)


@pytest.mark.slow
def test_a_static_scene_is_refused(tmp_path: Path, cli) -> None:
    code, _, said = cli("sync", *write_pair(tmp_path, 0.3, moves=False))
    assert (code, said.count("\n")) == (1, 1)
    assert "no evidence of their clock offset" in said


@pytest.mark.slow
def test_evidence_that_disagrees_is_refused(tmp_path: Path) -> None:
    videos = write_pair(tmp_path, 0.3, seconds=10, sound=True, sound_offset_s=0.9)
    with pytest.raises(
        InputError, match=r"motion says that the right clock is \+0.3.* sound says \+0.9"
    ):
        sync(*videos)
    with pytest.raises(InputError, match="sound says"):
        choose_frames(*videos, InputConfig())


@pytest.mark.slow
def test_other_dives_are_refused(tmp_path: Path) -> None:
    left, _ = write_pair(tmp_path / "a", 0.0)
    _, right = write_pair(tmp_path / "b", 40.0)
    with pytest.raises(InputError):
        sync(left, right)


def test_what_is_no_video_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "a.mp4").write_bytes(b"no video")
    (tmp_path / "empty.mp4").write_bytes(b"")
    left, _ = write_pair(tmp_path, 0.0, seconds=2)
    content = left.read_bytes()
    (tmp_path / "cut.mp4").write_bytes(content[: content.index(b"moov") - 4])
    unread = "is not a video that FFmpeg can read"
    for name, said in {
        "a.mp4": unread,
        "missing.mp4": unread,
        "empty.mp4": "is empty",
        "cut.mp4": r"has no index \(moov\): the recording was not finished",
    }.items():
        with pytest.raises(InputError, match=rf"^[^\n]*{name}: {said}[^\n]*$"):
            sync(tmp_path / name, tmp_path / name)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("faults", "said"),
    [
        ({"lost": 8, "place": 0.9}, "do not move alike"),
        ({"frozen": 10, "seconds": 8.0}, "left out"),
    ],
)
def test_pairs_of_other_moments_are_left_out(tmp_path: Path, faults: dict, said: str) -> None:
    """Frames that are lost near an end do not change the lag of the whole, nor do repeated ones."""
    faults = {"seconds": 12.0, "lost": 0, "place": 0.5, "frozen": 0} | faults
    chosen = choose_frames(*write_pair(tmp_path, 0.31, **faults), InputConfig())
    own_s = np.arange(round(RATE_HZ * faults["seconds"])) / RATE_HZ
    right_s, first = own_s - 0.31, int(faults["place"] * len(own_s))
    right_s[first:] += faults["lost"] / RATE_HZ
    right_s[first : first + faults["frozen"]] = right_s[first - 1]
    apart_s = np.abs(own_s[list(chosen.left)] - right_s[list(chosen.right)])
    assert said in chosen.notes[-1]
    assert len(apart_s) > 60
    assert apart_s.max() < 0.02


@pytest.mark.slow
def test_frames_of_equal_number_that_do_not_move_alike_are_no_pairs(tmp_path: Path) -> None:
    """Lost frames leave no lag that stands out; that is no reason to pair equal numbers."""
    with pytest.raises(InputError, match="frames of the same number do not move alike"):
        choose_frames(*write_pair(tmp_path, 0.31, seconds=8, lost=15, place=0.4), InputConfig())
    part = write_pair(tmp_path, 0.31, seconds=8, lost=12, place=0.35)
    chosen = choose_frames(*part, InputConfig())
    assert chosen.wrong == ("ranges",)
    assert "one file may lack frames" in chosen.notes[-1]


@pytest.mark.slow
def test_a_camera_that_is_mounted_turned_moves_alike(tmp_path: Path) -> None:
    """By a quarter or half a turn; two other dives move alike in none of them."""
    left, right = map(video_signals, write_pair(tmp_path, 0.0, seconds=8))
    equal = np.repeat(np.arange(len(left.times_s))[:, None], 2, axis=1)
    for turned in (right.motion, -right.motion, right.motion[:, ::-1] * [1, -1]):
        assert not unlike((left, replace(right, motion=turned)), equal).any()
    assert unlike((left, replace(right, motion=right.motion[::-1])), equal).mean() > 0.9


@pytest.mark.parametrize("lost", [1, 8])
def test_frames_that_one_file_lacks_are_named(tmp_path: Path, lost: int) -> None:
    with pytest.raises(InputError, match=r"around [\d.]+ s and -0\.\d+ s around [\d.]+ s: one"):
        sync(*write_pair(tmp_path, 0.0, seconds=12, lost=lost))


@pytest.mark.slow
@pytest.mark.parametrize(("lost", "place"), [(1, 0.1), (2, 0.9)])
def test_one_or_two_frames_that_are_lost_in_the_first_or_last_second_are_named(
    tmp_path: Path, lost: int, place: float
) -> None:
    """Parts of 3 s and the agreement of pairs do not show them."""
    with pytest.raises(InputError, match=r"around [\d.]+ s and \+0\.2\d+ s around [\d.]+ s: one"):
        sync(*write_pair(tmp_path, 0.31, seconds=12, lost=lost, place=place))


@pytest.mark.slow
def test_frames_that_are_lacking_near_an_end_of_the_overlap_are_named(tmp_path: Path) -> None:
    """Its halves alone hide them: one is then of both offsets."""
    with pytest.raises(
        InputError, match=r"-3\.6\d+ s relative .* and -3\.6\d+ s around .*: one of"
    ):
        sync(*write_pair(tmp_path, -3.6, seconds=10, lost=2))
    # 2 s of the 20 s that both have, which quarters hide, too
    with pytest.raises(
        InputError, match=r"\+15\.79\d s relative .* and \+15\.7\d+ s around .*: one"
    ):
        sync(*write_pair(tmp_path, 15.8, seconds=36, lost=2))


@pytest.mark.slow
def test_videos_of_which_a_third_has_no_partner_are_not_told_to_lack_frames(tmp_path: Path) -> None:
    found = sync(*write_pair(tmp_path, 3.3, seconds=10))
    assert abs(error_s(found, 3.3, 0.0)) < 3 * found.std_s


@pytest.mark.slow
def test_damaged_videos_are_one_line_or_read_as_far_as_they_go(tmp_path: Path) -> None:
    left, right = write_pair(tmp_path, 0.2, seconds=4)
    content, rng = right.read_bytes(), np.random.default_rng(1)
    for trial in range(12):
        damaged = bytearray(content[: rng.integers(100, len(content))] if trial % 2 else content)
        for _ in range(4):
            at = int(rng.integers(0, len(damaged)))
            damaged[at : at + 16] = rng.bytes(16)
        right.write_bytes(damaged)
        try:
            found = sync(left, right)
        except InputError as error:
            assert "\n" not in str(error)
        else:
            assert abs(found.offset_s - 0.2) < 0.1


@pytest.mark.slow
def test_run_takes_the_frames_that_are_nearest(tmp_path: Path) -> None:
    videos = write_pair(tmp_path, 10 / RATE_HZ)
    choice = choose_frames(*videos, InputConfig())
    assert {b - a for a, b in zip(choice.left, choice.right, strict=True)} == {10}
    dive = Videos(*videos)
    pairing = dive.pairing(dive.choice(InputConfig(video_step=20)))
    assert [pair.name for pair in pairing.pairs] == [
        f"{number:06d}" for number in range(0, 180, 20)
    ]
    assert [pair.timestamp_s for pair in pairing.pairs] == pytest.approx(
        np.arange(0, 180, 20) / RATE_HZ, abs=1e-9
    )
    assert "from motion" in pairing.notes[0]


def rig() -> StereoRig:
    """Of the drawn videos: rectified, rows in order."""
    camera = Camera(
        np.array([[300.0, 0, WIDTH / 2], [0, 300, HEIGHT / 2], [0, 0, 1]]),
        np.zeros(0),
        (WIDTH, HEIGHT),
    )
    right_of_left = np.eye(4)
    right_of_left[0, 3] = -0.1
    return StereoRig(camera, camera, right_of_left)


@pytest.mark.slow
@pytest.mark.parametrize("offset_s", [0.3137, -0.205])
def test_rows_tell_the_offset_to_a_fraction_of_a_frame(tmp_path: Path, offset_s: float) -> None:
    """From a lag that is wrong by a quarter of a frame, on cameras whose frames are not taken
    together.
    """
    videos = write_pair(tmp_path, offset_s)
    signals = tuple(map(synchronization.video_signals, videos))
    coarse = Lag(offset_s + 0.25 / RATE_HZ, 0.01)
    found = row_lag(videos, rig(), signals, coarse, paired(signals, coarse).pairs)
    assert found is not None
    assert abs(found.offset_s - offset_s) < min(0.001, 3 * found.std_s)


def test_frames_taken_together_count_more_than_their_neighbors() -> None:
    """What the pictures' motion misses grows with the time between two frames, and does not move
    the offset that frames of one moment show.
    """
    random = np.random.default_rng(0)
    speeds = random.normal(0, 0.02, 48)
    apart_s = np.where(np.arange(48) % 2, 1 / RATE_HZ, 0.0)
    missed = np.where(apart_s > 0, random.normal(-0.0003, 0.0003, 48), 0.0)
    rows = random.normal(0, 3e-6, 48)
    found = solve_shift(-speeds * apart_s, speeds, -speeds * apart_s + missed + rows, apart_s)
    assert found is not None
    assert abs(found[0]) < min(0.0005, 3 * found[1])


@pytest.mark.slow
def test_a_calibration_is_used_as_evidence(tmp_path: Path, cli) -> None:
    left, right = write_pair(tmp_path, 0.31)
    sizeless = tmp_path / "cam.npz"  # it stores no size, as some of MATLAB's
    np.savez(
        sizeless,
        K1=rig().left.K,
        D1=np.zeros(5),
        K2=rig().right.K,
        D2=np.zeros(5),
        R=rig().T_right_left[:3, :3],
        T=rig().T_right_left[:3, 3],
    )
    code, printed, said = cli("sync", left, right, "--calib", sizeless)
    assert code == 0, said
    assert "from motion and rows" in printed
    other = replace(
        rig(),
        left=replace(rig().left, image_size=(640, 480)),
        right=replace(rig().right, image_size=(640, 480)),
    )
    write_rig(other, tmp_path / "other.yaml")
    assert [item.kind for item in sync(left, right, str(tmp_path / "other.yaml")).evidence] == [
        "motion"
    ]


@pytest.mark.slow
def test_a_picture_that_does_not_move_up_or_down_tells_nothing_by_rows(tmp_path: Path) -> None:
    videos = write_pair(tmp_path, 0.0, seconds=4, moves=False)
    signals = tuple(map(synchronization.video_signals, videos))
    lag = Lag(0.0, 0.01)
    assert row_lag(videos, rig(), signals, lag, paired(signals, lag).pairs) is None


@pytest.mark.slow
def test_motion_that_spoils_nearly_all_pairs_is_refused(tmp_path: Path) -> None:
    """Frames half a frame apart, and a picture that is fast."""
    videos = write_pair(tmp_path, 10.5 / RATE_HZ, seconds=8, speed=3.0)
    with pytest.raises(
        InputError, match=r"px of false disparity at 1920 px; film at a higher rate"
    ):
        sync(*videos)
    choice = choose_frames(*videos, InputConfig(video_offset_s=10.5 / RATE_HZ))
    assert len(choice.left) > 150


@pytest.mark.slow
def test_pairs_that_motion_spoils_are_left_out(tmp_path: Path) -> None:
    found = sync(*write_pair(tmp_path, 10.5 / RATE_HZ, seconds=8))
    assert found.left_out > 20
    assert found.pairs > 20
    assert found.false_disparity < 1e-3
    assert "pairs with a motion of more than 0.1% are left out" in found.text


@pytest.mark.slow
def test_frames_are_chosen_by_their_overlap(tmp_path: Path) -> None:
    videos = write_pair(tmp_path, 0.0, seconds=8, speed=3.0)
    choice = choose_frames(*videos, InputConfig(video_step=0.8))
    at = swell(np.arange(240) / RATE_HZ)[list(choice.left)] * 3.0
    x, y = np.abs(np.diff(at, axis=0)).T
    overlap = (1 - x / WIDTH) * (1 - y / HEIGHT)
    assert 5 < len(choice.left) < 200
    assert overlap.max() < 0.83
    assert overlap.min() > 0.6  # it moves on by some frames only
    assert "overlap 80%" in choice.notes[-1]
    still = write_pair(tmp_path / "still", 0.0, seconds=4, moves=False)
    assert choose_frames(*still, InputConfig(video_step=0.8)).left == (0,)


@pytest.mark.slow
def test_blurred_frames_are_left_out_on_demand(tmp_path: Path) -> None:
    videos = write_pair(tmp_path, 0.0, seconds=4, moves=False, blurred=(20, 21, 50))
    config = InputConfig(video_skip_blurred=True, video_step=10)
    choice = choose_frames(*videos, config)
    assert choice.left == choice.right == (0, 10, 22, 30, 40, 51, 60, 70, 80, 90, 100, 110)
    assert "3 of 120 pairs are blurred" in choice.notes[-1]
    alone = choose_frames(videos[0], videos[0], config)
    assert alone.left == choice.left


@pytest.mark.slow
def test_an_offset_can_be_given(tmp_path: Path) -> None:
    videos = write_pair(tmp_path, 0.0, seconds=4, moves=False)
    choice = choose_frames(*videos, InputConfig(video_offset_s=1.0))
    assert choice.left == tuple(range(90))
    assert choice.right == tuple(range(30, 120))
    with pytest.raises(InputError, match="do not overlap"):
        choose_frames(*videos, InputConfig(video_offset_s=9.0))


@pytest.mark.slow
def test_without_evidence_frames_of_the_same_number_are_pairs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import sys

    videos = write_pair(tmp_path, 0.5, seconds=4, moves=False)
    choice = choose_frames(*videos, InputConfig(video_step=7))
    assert choice.left == choice.right == tuple(range(0, 120, 7))
    assert choice.notes[0].startswith("frames of the same number are paired: ")
    monkeypatch.setitem(sys.modules, "av", None)
    KNOWN_SIGNALS.clear()  # else nothing is decoded
    for missing in (sync, lambda left, right: choose_frames(left, right, InputConfig())):
        with pytest.raises(DeviceError, match=r"library that is missing.*\[video\]'"):
            missing(*videos)


def test_a_line_through_offsets_leaves_out_what_is_far_off() -> None:
    at = np.arange(0.0, 600.0, 5.0)
    offsets_s = 1.0 + 40e-6 * (at - 300) + np.random.default_rng(0).normal(0, 2e-4, len(at))
    offsets_s[::10] += 0.08
    found = straight_lag(at, offsets_s, 1e-4)
    assert found is not None
    assert found.offset_s == pytest.approx(
        1.0 + 40e-6 * (found.center_s - 300), abs=3 * found.std_s
    )
    assert found.drift == pytest.approx(40e-6, abs=3 * found.drift_std)
    assert straight_lag(at[:2], offsets_s[:2], 1e-4) is None
