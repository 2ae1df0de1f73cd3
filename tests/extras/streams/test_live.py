"""Live: the newest pair wins, drops are counted, nothing that a pair does ends it, memory is
flat.
"""

import json
import os
import re
import shutil
import subprocess
import sys
import time
import tracemalloc
import urllib.error
import urllib.request
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from pathlib import Path
from threading import Event, Timer
from types import SimpleNamespace
from typing import Any
from unittest.mock import MagicMock

import cv2
import numpy as np
import pytest
from bag_writers import START_NS, camera_infos, dive_messages, name_by_stamps, write_bag

from calibration import CalibrationError
from calibration.formats import load_rig, write_rig
from stereo_seecolor.checks import rig as checks_rig
from stereo_seecolor.checks.changes import DiveChange
from stereo_seecolor.checks.verdict import COLORS, RANGES, DiveVerdict
from stereo_seecolor.color.sharing.survey import SlidingFitter
from stereo_seecolor.config import InputConfig, RunConfig
from stereo_seecolor.config.file import load_config
from stereo_seecolor.errors import ColorError, InputError, OutputError
from stereo_seecolor.extras.streams.bags.dive import open_dive
from stereo_seecolor.extras.streams.live import command as live_command
from stereo_seecolor.extras.streams.live import session as live_session
from stereo_seecolor.extras.streams.live.budget import Budget
from stereo_seecolor.extras.streams.live.command import LiveInputs, LiveOptions, live
from stereo_seecolor.extras.streams.live.folder_watch import FolderWatch
from stereo_seecolor.extras.streams.live.outputs import KeptFiles
from stereo_seecolor.extras.streams.live.played_bag import PlayedBag
from stereo_seecolor.extras.streams.live.preview import Preview, served
from stereo_seecolor.extras.streams.live.processing import LiveProcessor
from stereo_seecolor.extras.streams.live.session import LiveCounts, LiveSession
from stereo_seecolor.extras.streams.live.sources import source_of
from stereo_seecolor.extras.streams.mcap_recording import TOPICS
from stereo_seecolor.files.previews import range_picture
from stereo_seecolor.inputs.pairing import Pair
from stereo_seecolor.matching.reduced import ReducedMatcher
from stereo_seecolor.pipeline import Pipeline


@pytest.fixture
def incoming(make_dive, tmp_path):
    """A dive of four pairs, two empty folders, and a function that lets a pair arrive."""
    dive = make_dive(4)
    for side in "LR":
        (tmp_path / "in" / side).mkdir(parents=True)

    def arrive(number: int, sides: str = "LR") -> None:
        for side in sides:
            shutil.copy(dive.root / side / f"{number:04d}.png", tmp_path / "in" / side)

    return dive, tmp_path / "in", arrive


def watch(folder: Path) -> FolderWatch:
    return FolderWatch(folder / "L", folder / "R", InputConfig())


def test_the_newest_pair_wins_and_the_others_are_counted(incoming) -> None:
    _, folder, arrive = incoming
    source = watch(folder)
    assert source.newest() is None
    for number in range(3):
        arrive(number)
    pair = source.newest()
    assert pair is not None
    assert pair.name == "0002"
    source.take(pair)
    assert (source.dropped, source.newest()) == (2, None)
    arrive(3, "L")
    assert source.newest() is None
    arrive(3, "R")
    source._left.listed_s = source._right.listed_s = -10.0  # as after a second
    found = source.newest()
    assert found is not None
    assert found.name == "0003"
    source.take(found)
    assert source.dropped == 2


def test_a_folder_that_vanishes_is_waited_for(incoming) -> None:
    _, folder, arrive = incoming
    source = watch(folder)
    arrive(0)
    first = source.newest()
    assert first is not None
    source.take(first)
    shutil.move(folder / "R", folder / "away")
    assert source.newest() is None
    assert source.waiting == str(folder / "R")
    shutil.move(folder / "away", folder / "R")
    arrive(1)
    found = source.newest()
    assert found is not None
    assert (found.name, source.waiting) == ("0001", "")


@pytest.mark.parametrize("name", ["{:04d}.png", "reef_17900000{:02d}000.png"])
def test_files_of_other_moments_are_no_pair(tmp_path: Path, name: str) -> None:
    """The left camera lost two images, and the right one is late: equal steps of numbers and of
    time stamps do not make partners.
    """
    source = arriving(tmp_path, [("L", 7), ("L", 8), ("L", 9), ("R", 5), ("R", 6), ("R", 7)], name)
    found = source.newest()
    assert found is not None
    assert found.left.name == found.right.name == name.format(7)
    alone = arriving(tmp_path / "alone", [("L", 7), ("L", 8), ("L", 9), ("R", 4), ("R", 5)], name)
    assert alone.newest() is None
    assert "no left image matches a right one by name or time stamp" in alone.waiting
    arrives(alone, "R", name.format(6))
    assert alone.newest() is None


def test_what_is_common_to_the_names_of_a_side_is_learned(tmp_path: Path) -> None:
    """One new file of each side does not show it: then every second pair was skipped."""
    source = arriving(
        tmp_path, [("L", 98), ("R", 98), ("L", 99), ("R", 99)], "serial{1}_{0:04d}.png"
    )
    names = []
    for number in (100, 101, 102):
        pair = source.newest()
        assert pair is not None
        source.take(pair)
        names.append(pair.name)
        for side in "LR":
            arrives(source, side, f"serial{1 + 'LR'.index(side)}_{number:04d}.png")
    assert names == ["0099", "0100", "0101"]


def arriving(folder: Path, files: list[tuple[str, int]], name: str) -> FolderWatch:
    """A watch of two folders with these files. name: with {0}, the number, and {1}, of the side."""
    for side in "LR":
        (folder / side).mkdir(parents=True)
    source = watch(folder)
    for side, number in files:
        arrives(source, side, name.format(number, 1 + "LR".index(side)))
    return source


def arrives(source: FolderWatch, side: str, name: str) -> None:
    of_side = {"L": source._left, "R": source._right}[side]
    (of_side.folder / name).write_bytes(b"")
    of_side.modified_ns = -1  # as after some milliseconds


def test_what_is_waited_for_is_said_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(live_session, "SILENT_S", 0.0)
    for side in "LR":
        (tmp_path / side).mkdir()
    source, told = watch(tmp_path), []
    session = LiveSession(source, lambda pair: Corrected(), lambda _: None, tell=told.append)
    left, right = str(tmp_path / "L"), str(tmp_path / "R")

    def waits() -> str:
        time.sleep(0.001)
        assert not session.step()
        return session.counts.waiting

    assert waits() == waits() == f"{left} and {right}"
    assert not session.counts.has_unpaired
    arrives(source, "L", "a.png")
    assert waits() == right
    assert session.counts.has_unpaired
    arrives(source, "R", "b.png")
    assert waits().endswith(
        "by name or time stamp, for example a.png and b.png: give both files the same name, or "
        "set a larger input.timestamp_tolerance_s"
    )
    arrives(source, "R", "a.png")
    assert session.step()
    assert (session.counts.waiting, session.counts.has_unpaired) == ("", False)
    assert [line.split()[0] for line in told] == ["waiting"] * 3
    first = live_session.WaitNotice(told.append)
    time.sleep(0.001)
    source.waiting = ""
    assert first.waiting(source, None).startswith("two images of one time")


@pytest.mark.parametrize("has_unpaired", [True, False])
def test_a_side_that_stops_alone_gives_exit_code_3(has_unpaired: bool, cli, monkeypatch) -> None:
    """Both stop at the end of a dive."""
    numbers = LiveCounts(done=9, waiting="R", has_unpaired=has_unpaired).facts()
    ended = SimpleNamespace(**numbers, notes=(), wrong=())
    monkeypatch.setattr(live_command, "live", lambda *_: ended)
    code, printed, _ = cli("live", "--left", "L", "--right", "R", "--calib", "cam.yaml")
    assert code == (3 if has_unpaired else 0)
    alone = ", while images without a partner came" * has_unpaired
    assert f"at the end it waited for R{alone}\n" in printed


def test_the_first_of_each_kind_of_error_and_warning_is_told() -> None:
    told: list[str] = []

    def process(pair: Pair):
        if pair.name in ("000001", "000004"):
            raise CalibrationError("the left image is of another size")
        warnings = (f"rows are off by {int(pair.name)}.5 px",) if pair.name > "000001" else ()
        return Corrected(result=corrected(warnings, rows_are_off=pair.name == "000002"), pair=pair)

    session = LiveSession(Endless(), process, lambda _: None, tell=told.append)
    counts = session.run(lambda counts: counts.done + counts.failed >= 6)
    assert (counts.done, counts.failed, counts.biased) == (4, 2, 1)
    assert counts.last_error == "000004: the left image is of another size"
    assert told == [
        "a pair failed: 000001: the left image is of another size",
        "000002: rows are off by 2.5 px",
    ]


@pytest.mark.slow
def test_failed_pairs_count_as_pairs_and_exit_with_3(incoming, cli) -> None:
    dive, folder, _ = incoming
    for side in "LR":
        (folder / side / "0000.png").write_bytes(b"no image")
    sides = ("--left", folder / "L", "--right", folder / "R", "--calib", dive.root / "cam.yaml")
    code, printed, said = cli("live", *sides, "--pairs", 1)
    assert (code, printed.startswith("0 pairs corrected, 1 failed")) == (3, True)
    assert said.startswith("a pair failed: ")


@pytest.mark.slow
def test_a_calibration_that_does_not_fit_ends_with_3(incoming, cli, tmp_path) -> None:
    dive, folder, arrive = incoming
    rig = load_rig(dive.root / "cam.yaml")
    turned = rig.T_right_left.copy()
    turned[:3] = cv2.Rodrigues(np.array([0.008, 0, 0]))[0] @ turned[:3]
    write_rig(replace(rig, T_right_left=turned), tmp_path / "turned.yaml")
    arrive(0)
    sides = ("--left", folder / "L", "--right", folder / "R", "--pairs", 1)
    code, printed, said = cli("live", *sides, "--calib", tmp_path / "turned.yaml")
    assert (code, "the ranges of 1 pair are biased: the calibration does" in printed) == (3, True)
    assert "0000: vertical disparity of" in said
    code, printed, _ = cli("live", *sides, "--calib", dive.root / "cam.yaml")
    assert (code, "biased" in printed) == (0, False)


@pytest.mark.slow
def test_what_single_pairs_do_not_show_is_checked_at_the_end(incoming, cli, monkeypatch) -> None:
    dive, folder, arrive = incoming
    checked = []

    def check(_: Pipeline, pairs: Sequence[Pair]) -> DiveVerdict:
        checked.extend(pair.name for pair in pairs)
        return DiveVerdict(("calibration: a yaw",), RANGES)

    monkeypatch.setattr(live_command, "check_processed", check)
    arrive(0)
    sides = ("--left", folder / "L", "--right", folder / "R", "--calib", dive.root / "cam.yaml")
    code, printed, said = cli("live", *sides, "--pairs", 1)
    assert (code, checked) == (3, ["0000"])
    assert "note: calibration: a yaw\n" in printed
    assert "checking the calibration against 1 pair\n" in said


def test_pairs_are_checked_from_the_first_that_was_taken_to_the_last(incoming) -> None:
    _, folder, arrive = incoming
    for number in (0, 1):
        arrive(number)
    source = watch(folder)
    assert source.still_there() == ()
    for number in (2, 3):
        pair = source.newest()
        assert pair is not None
        source.take(pair)
        arrive(number)
    source.newest()
    assert [pair.name for pair in source.still_there()] == ["0001", "0002"]
    (folder / "L/0002.png").unlink()
    assert source.still_there() == ()


def test_all_pairs_are_checked_where_files_arrive_in_another_order(incoming) -> None:
    _, folder, arrive = incoming
    source = watch(folder)
    for number in (2, 3, 0, 1):
        arrive(number)
        source._left.listed_s = source._right.listed_s = -10.0  # as after a second
        pair = source.newest()
        assert pair is not None
        source.take(pair)
    assert [pair.name for pair in source.still_there()] == ["0000", "0001", "0002", "0003"]


def test_a_calibration_is_read_and_doubted_as_run_does(incoming, monkeypatch) -> None:
    """Of two readings the images choose; the first pair shows nothing."""
    dive, folder, arrive = incoming
    true = replace(_rig(dive.root), rms_px=2.0)
    turned = true.T_right_left.copy()
    turned[:3, :3] = cv2.Rodrigues(np.array([0.05, 0.0, 0.0]))[0]
    two = replace(true, T_right_left=turned).with_alternatives([true])
    monkeypatch.setattr(live_command, "load_rig", lambda *_: two)
    monkeypatch.setattr(live_command, "load_rig_of_images", lambda *_: two)
    for side in "LR":
        cv2.imwrite(str(folder / side / "0000.png"), np.zeros(dive.range_m.shape, np.uint8))
    Timer(0.5, arrive, (1,)).start()
    told: list[str] = []
    with ExitStack() as stack:
        inputs = LiveInputs(folder / "L", folder / "R", calib="cam.yaml")
        _, pipeline, opened = inputs.open(RunConfig(), stack, told.append)
    np.testing.assert_array_equal(pipeline.rig.T_right_left, true.T_right_left)
    assert [line.split(":")[:2] for line in told] == [
        ["0000", " does not show how to read the calibration"]
    ]
    assert any("this reading fits the images" in note for note in opened.notes)
    assert any("the reprojection error" in note for note in opened.notes)


MEASURED = ("color.input_encoding=linear", "color.pedestal=[0.08, 0.05, 0.04]")


def test_how_files_are_read_is_settled_in_a_bag_and_named_in_folders(
    make_dive, tmp_path, monkeypatch
) -> None:
    """12 bits, then what several images show of their response and one does not."""
    dive = make_dive(2, dtype=np.uint16)
    for path in [*(dive.root / "L").iterdir(), *(dive.root / "R").iterdir()]:
        cv2.imwrite(str(path), cv2.imread(str(path), cv2.IMREAD_UNCHANGED) >> 4)
    pairs = FolderWatch(dive.root / "L", dive.root / "R", InputConfig())
    newest = pairs.newest()
    assert newest is not None
    needed = ["input.significant_bits=12"]
    given, missing = (
        live_command._misread(Pipeline(_rig(dive.root), load_config(None, settings)), [newest])
        for settings in (needed, [])
    )
    assert (given.notes, missing.wrong) == ((), COLORS)
    assert missing.notes[0].endswith(f" --set {needed[0]}")
    monkeypatch.setattr(
        live_command, "settle_response", lambda config, _: (load_config(None, MEASURED), ())
    )
    linear = live_command._misread(Pipeline(_rig(dive.root), RunConfig()), [newest])
    assert linear.notes[0].endswith(" --set ".join(["with", MEASURED[0], f"'{MEASURED[1]}'"]))
    name_by_stamps(dive.root)
    bag = write_bag(
        tmp_path / "b.bag", [*camera_infos(dive.root / "cam.yaml"), *dive_messages(dive.root)]
    )
    with ExitStack() as stack:
        source, _, opened = LiveInputs(bag=bag).open(RunConfig(), stack, print)
    first = source.newest()
    assert first is not None
    assert source.read(first).left.max() > 1 << 12
    assert "input: the 16-bit images hold 12 bits, which are scaled to 16" in opened.notes


@pytest.mark.parametrize(
    ("change", "is_wrong"),
    [
        (DiveChange("sides", is_rigid=False), True),
        (DiveChange("odd", frozenset("a")), True),
        (DiveChange(), False),
    ],
)
def test_pairs_that_run_would_refuse_or_leave_out_are_wrong(
    change: DiveChange, is_wrong: bool, monkeypatch
) -> None:
    def check_rig(*_: Any) -> DiveVerdict:
        if not change.is_rigid:
            raise InputError(change.line)
        return DiveVerdict()

    monkeypatch.setattr(checks_rig, "find_change", lambda *_: change)
    monkeypatch.setattr(checks_rig, "check_rig", check_rig)
    found = checks_rig.check_processed(MagicMock(), ())
    assert found.wrong == (RANGES if is_wrong else frozenset())
    assert found.notes == (() if change.is_rigid else ("calibration: sides",))


@pytest.mark.slow
def test_a_camera_that_counts_from_zero_again_replaces_nothing(incoming, tmp_path) -> None:
    dive, folder, arrive = incoming
    arrive(0)
    source, pipeline = watch(folder), Pipeline(_rig(dive.root), RunConfig())
    pair = source.newest()
    assert pair is not None
    frame = LiveProcessor(pipeline, source.read).process(pair)
    keep = KeptFiles(tmp_path / "kept", 1, pipeline)
    for _ in range(3):
        keep(frame)
    names = {path.name for path in (tmp_path / "kept/corrected").iterdir()}
    assert names == {"0000.png", "0000~2.png", "0000~3.png"}


def test_files_do_not_arrive_before_the_program_looks_for_them(incoming) -> None:
    """Neither those that were there, nor those that are copied with their old times."""
    _, folder, arrive = incoming
    arrive(0)
    old_s = time.time() - 1000
    for side in "LR":
        for path in (folder / side).iterdir():
            os.utime(path, (old_s, old_s))
    source = watch(folder)
    began_s = time.time()
    first = source.newest()
    assert first is not None
    assert source.latency_s(first) <= time.time() - began_s + 0.1
    source.take(first)
    arrive(1)
    for side in "LR":
        for path in (folder / side).iterdir():
            os.utime(path, (old_s, old_s))
    second = source.newest()
    assert second is not None and second.name == "0001"
    assert source.latency_s(second) <= time.time() - began_s + 0.1
    later_s = time.time() + 100
    os.utime(second.left, (later_s, later_s))
    assert source.latency_s(second) == 0  # it grew on, by a clock that is ahead


@pytest.mark.slow
def test_live_gives_what_a_sliding_run_gives(incoming, cli, tmp_path) -> None:
    dive, folder, arrive = incoming
    source, images = watch(folder), {}
    processor = LiveProcessor(Pipeline(_rig(dive.root), RunConfig()), source.read)
    for number in range(2):
        arrive(number)
        pair = source.newest()
        assert pair is not None
        images[pair.name] = processor.process(pair).result.correction.image
        source.take(pair)
    sides = ("--left", folder / "L", "--right", folder / "R", "--calib", dive.root / "cam.yaml")
    assert cli("run", *sides, "--out", tmp_path / "out", "--set", "color.lock=20")[0] == 0
    for name, image in images.items():
        stored = cv2.imread(str(tmp_path / f"out/corrected/{name}.png"))[..., ::-1]
        assert np.abs(stored.astype(int) - image).max() <= 1


def _rig(root: Path):
    from calibration.formats import load_rig

    return load_rig(root / "cam.yaml")


class Endless:
    """A source that always has one more pair."""

    dropped = 0
    waiting = ""

    def __init__(self, pairs: int = 1 << 40) -> None:
        self.number, self.pairs = 0, pairs

    @property
    def ended(self) -> bool:
        return self.number >= self.pairs

    def read(self, pair: Pair):
        raise AssertionError

    def latency_s(self, pair: Pair) -> float:
        return 0.1

    def newest(self) -> Pair:
        return Pair(f"{self.number:06d}", Path("left"), Path("right"))

    def take(self, pair: Pair) -> None:
        self.number += 1

    def still_there(self) -> tuple[Pair, ...]:
        return ()


def corrected(warnings: tuple[str, ...] = (), rows_are_off: bool = False) -> SimpleNamespace:
    range_map = SimpleNamespace(rows_are_off=rows_are_off)
    return SimpleNamespace(warnings=warnings, range_map=range_map)


@dataclass
class Corrected:
    """What a session needs of a corrected pair."""

    reduced: str = ""
    result: Any = field(default_factory=lambda: corrected())
    pair: Pair | None = None


@pytest.mark.slow
def test_memory_is_flat_over_20_000_pairs() -> None:
    """Counts and queue hold nothing of the pairs that are over: one byte of each would be seen."""
    most = 0

    def process(pair: Pair):
        nonlocal most
        if pair.name.endswith("7"):
            raise ColorError(f"{pair.name}: no color")
        most = max(most, len(session._behind._waiting))
        return Corrected()

    session = LiveSession(Endless(20_000), process, lambda _: None)
    for _ in range(1000):
        session.step()
    tracemalloc.start()
    before = tracemalloc.get_traced_memory()[0]
    counts = session.run(lambda _: False)
    grown = tracemalloc.get_traced_memory()[0] - before
    tracemalloc.stop()
    assert grown < 15_000
    assert (counts.done, counts.failed, most <= 2) == (18_000, 2_000, True)
    assert counts.last_error == "019997: no color"


def test_pairs_wait_when_two_are_still_being_written() -> None:
    gate, written, processed = Event(), [], []

    def process(pair: Pair):
        processed.append(pair.name)
        if len(processed) == 4:
            gate.set()
        return Corrected(pair.name)

    def finish(frame: Corrected) -> None:
        assert gate.wait(20) or len(processed) <= 3
        written.append(frame.reduced)

    session = LiveSession(Endless(3), process, finish)
    opener = Timer(0.2, gate.set)
    opener.start()
    session.run(lambda _: False)
    opener.join()
    assert written == processed == ["000000", "000001", "000002"]
    assert len(session.counts.products_s) == 3


@pytest.mark.slow
def test_a_window_of_colors_is_flat_too(make_dive) -> None:
    pipeline = Pipeline(_rig(make_dive(1).root), RunConfig())
    image = np.random.default_rng(0).integers(0, 200, (40, 50, 3), np.uint8)
    range_m = np.random.default_rng(1).uniform(1, 2, (40, 50)).astype(np.float32)
    fitter = SlidingFitter(RunConfig().color.model_copy(update={"lock": 2}), pipeline.corrector.fit)
    for _ in range(5):
        assert fitter.water(pipeline.corrector.measure(image, range_m)) is not None
    assert (len(fitter._window), fitter._waters) == (2, {})


def test_a_file_that_is_still_written_is_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    readable = False

    def process(pair: Pair):
        if not readable:
            raise InputError(f"{pair.name}: is truncated")
        return Corrected()

    session = LiveSession(Endless(), process, lambda _: None)
    assert not session.step()
    readable = True
    assert session.step()
    assert (session.counts.done, session.counts.failed) == (1, 0)
    readable = False
    monkeypatch.setattr(live_session, "SETTLE_S", 0.0)
    assert session.step()
    assert (session.counts.failed, session.counts.last_error) == (1, "000001: is truncated")


def test_a_full_disk_ends_it_and_ctrl_c_too() -> None:
    def full(_: object) -> None:
        raise OutputError("full")

    with pytest.raises(OutputError, match="full"):
        LiveSession(Endless(), lambda _: Corrected(), full).run(lambda _: False)

    def interrupted(pair: Pair):
        if pair.name == "000001":
            raise KeyboardInterrupt
        return Corrected()

    finished: list[Corrected] = []
    assert (
        LiveSession(Endless(), interrupted, finished.append).run(lambda _: False).done
        == len(finished)
        == 1
    )


@pytest.mark.slow
def test_the_command_keeps_products_and_says_what_happened(incoming, cli, tmp_path) -> None:
    dive, folder, arrive = incoming
    for number in range(4):
        arrive(number)
    sides = ("--left", folder / "L", "--right", folder / "R", "--calib", dive.root / "cam.yaml")
    code, printed, said = cli("live", *sides, "--pairs", 1, "--out", tmp_path / "kept", "--port", 0)
    assert code == 0, said
    assert said.startswith("http://127.0.0.1:")
    assert "1 pair corrected, 0 failed, 3 skipped for newer ones" in printed
    assert "3 pairs before 0003 skipped: live corrects the newest pair; run corrects all" in said
    assert (tmp_path / "kept/corrected/0003.png").is_file()
    assert (tmp_path / "kept/range/0003.tiff").is_file()
    code, _, said = cli("live", *sides, "--pairs", 1, "--out", tmp_path / "kept")
    assert (code, "in a new or an empty folder; nothing was changed" in said) == (1, True)


@pytest.mark.slow
def test_one_source_names_both_sides(incoming, cli, tmp_path) -> None:
    dive, folder, arrive = incoming
    arrive(0)
    calib = ("--calib", dive.root / "cam.yaml", "--pairs", 1)
    assert cli("live", "--source", f"{folder / 'L'},{folder / 'R'}", *calib)[0] == 0
    for side, name in (("L", "left"), ("R", "right")):
        (folder / side).rename(folder / name)
    assert "1 pair corrected" in cli("live", "--source", folder, *calib)[1]
    assert source_of("rtsp://10.0.0.2/both") == (
        "rtsp://10.0.0.2/both",
        "rtsp://10.0.0.2/both",
        None,
    )
    code, _, said = cli("live", "--source", folder, "--left", folder, *calib)
    assert (code, "--source names both sides: omit --left, --right and --bag" in said) == (2, True)


@pytest.mark.slow
def test_the_page_shows_the_last_pair_to_this_machine_alone(incoming) -> None:
    dive, folder, arrive = incoming
    arrive(0)
    counts = LiveCounts(waiting="somewhere")
    preview = Preview(counts)
    pair = watch(folder).newest()
    assert pair is not None
    with served(preview, 0) as address:
        status = json.loads(urllib.request.urlopen(address + "status.json").read())
        assert (status["name"], status["waiting"]) == ("", "somewhere")
        preview.update(
            LiveProcessor(Pipeline(_rig(dive.root), RunConfig()), watch(folder).read).process(pair)
        )
        counts.waiting, counts.done = "", 1
        counts.images_s.append(0.25)
        assert b"<title>stereo-seecolor live" in urllib.request.urlopen(address).read()
        status = json.loads(urllib.request.urlopen(address + "status.json").read())
        facts = status["facts"]
        assert (status["name"], facts["Pairs corrected"]) == ("0000", "1")
        assert facts["From arrival to image"] == "0.25 s (95 % within 0.25 s)"
        assert status["pair"]["Light that remains after 1 m, R G B"].endswith(" %")
        assert b".verdict" in urllib.request.urlopen(address + "page.css").read()
        for picture in ("corrected.jpg", "range.jpg"):
            content = urllib.request.urlopen(f"{address}{picture}?0000").read()
            assert cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_COLOR).shape == (
                128,
                176,
                3,
            )
        for path, host in (("../etc/passwd", "127.0.0.1"), ("status.json", "elsewhere.example")):
            with pytest.raises(urllib.error.HTTPError, match="404"):
                urllib.request.urlopen(
                    urllib.request.Request(address + path, headers={"Host": host})
                )
        port = int(address.rsplit(":", 1)[1].strip("/"))
        with pytest.raises(OutputError, match="choose another --port"), served(preview, port):
            pass


@pytest.mark.slow
def test_live_ends_after_so_many_pairs_and_names_what_is_written(incoming, monkeypatch) -> None:
    dive, folder, arrive = incoming
    arrive(2)
    inputs = LiveInputs(folder / "L", folder / "R", calib=dive.root / "cam.yaml")
    found = live(inputs, options=LiveOptions(pairs=1))
    assert (found.done, found.failed, found.dropped, found.last_error) == (1, 0, 0, "")
    told: list[str] = []

    def full(_: object) -> None:
        raise OutputError("full")

    monkeypatch.setattr(live_command, "_made", lambda *_: [full])
    with pytest.raises(OutputError, match="full"):
        live(inputs, options=LiveOptions(pairs=1, announce=told.append))
    assert told[-1] == "1 pair corrected, 0 failed; the outputs of 0 are complete"


@pytest.mark.slow
def test_a_calibration_without_a_size_takes_that_of_the_first_pair(incoming, tmp_path) -> None:
    dive, folder, arrive = incoming
    arrive(0, "L")
    (folder / "L/0001.png").write_bytes((dive.root / "L/0001.png").read_bytes()[:99])
    for number in (1, 2):
        arrive(number, "R")
    Timer(1.0, arrive, (2, "L")).start()
    rig = load_rig(dive.root / "cam.yaml")
    matrices = {"K1": rig.left.K, "D1": rig.left.distortion, "K2": rig.right.K, "R": rig.R}
    matrices |= {"D2": rig.right.distortion, "T": rig.T_right_left[:3, 3]}
    np.savez(tmp_path / "rig.npz", **matrices)
    inputs = LiveInputs(folder / "L", folder / "R", calib=tmp_path / "rig.npz")
    found = live(inputs, options=LiveOptions(pairs=1))
    assert (found.done, found.last_error) == (1, "")


@pytest.mark.slow
def test_a_bag_is_played_at_its_own_rate(make_dive, cli, tmp_path) -> None:
    dive = make_dive(4)
    name_by_stamps(dive.root)
    bag = write_bag(
        tmp_path / "b.bag", [*camera_infos(dive.root / "cam.yaml"), *dive_messages(dive.root)]
    )
    pairing, now_s = open_dive(bag, "", InputConfig()).pairing, [100.0]
    played = PlayedBag(pairing, bag, InputConfig(), lambda: now_s[0])
    taken = []
    for step_s in (0.0, 0.1, 0.16, 0.5):  # pairs are 0.25 s apart
        now_s[0] += step_s
        if pair := played.newest():
            taken.append((pairing.pairs.index(pair), round(played.latency_s(pair), 3)))
            played.take(pair)
    assert taken == [(0, 0.0), (1, 0.01), (3, 0.01)]
    assert (played.dropped, played.ended) == (1, True)
    assert list(played.still_there()) == list(pairing.pairs)
    assert source_of(str(bag)) == ("", "", bag)
    code, printed, said = cli("live", "--source", bag)
    assert code == 0, said
    done, dropped = (
        int(re.search(rf"(\d+) {what}", printed)[1])
        for what in ("pairs corrected", "skipped for newer ones")
    )  # type: ignore[index]
    assert done + dropped == 4


@pytest.mark.slow
def test_the_page_for_other_machines_needs_its_token(incoming) -> None:
    with served(Preview(LiveCounts()), 0, "127.0.0.2") as address:
        assert len(address.rstrip("/").rsplit("/", 1)[1]) >= 20
        assert json.loads(urllib.request.urlopen(address + "status.json").read())["name"] == ""
        bare = address.rstrip("/").rsplit("/", 1)[0]
        for path in ("/", "/status.json", "/wrong-token/status.json"):
            with pytest.raises(urllib.error.HTTPError, match="404"):
                urllib.request.urlopen(bare + path)


@pytest.mark.slow
def test_a_recording_and_every_second_pair_are_kept(make_dive, cli, tmp_path) -> None:
    from rosbags.rosbag2 import Reader

    dive = make_dive(3)
    name_by_stamps(dive.root)
    bag = write_bag(
        tmp_path / "b.bag", [*camera_infos(dive.root / "cam.yaml"), *dive_messages(dive.root)]
    )
    words = (
        "--record",
        tmp_path / "live.mcap",
        "--out",
        tmp_path / "kept",
        "--every",
        2,
        "--budget-ms",
        60_000,
    )
    code, printed, said = cli("live", "--bag", bag, *words)
    assert code == 0, said
    done = int(re.search(r"(\d+) pairs corrected", printed)[1])  # type: ignore[index]
    assert "all products: median" in printed
    assert len(list((tmp_path / "kept/corrected").iterdir())) == -(-done // 2)
    with Reader(tmp_path / "live.mcap") as reader:
        counts = {topic: info.msgcount for topic, info in reader.topics.items() if info.msgcount}
        stamps = [time_ns for _, time_ns, _ in reader.messages()]
    assert counts == dict.fromkeys((topic for topic in TOPICS if topic != "/tf"), done)
    assert stamps[0] == START_NS
    code, _, said = cli("live", "--bag", bag, "--record", tmp_path / "live.mcap")
    assert (code, "already exists, and is not overwritten" in said) == (1, True)


def test_a_process_is_pinned_with_its_threads_and_those_that_it_starts_later() -> None:
    """In a process of its own: it cannot be undone for the threads of this one."""
    if not hasattr(os, "sched_setaffinity"):
        pytest.skip("this system pins no processes")
    script = (
        "import os, threading, time\nfrom stereo_seecolor.compute.background import pin\n"
        "from stereo_seecolor.compute.threads import cores\n"
        "early = threading.Thread(target=time.sleep, args=(20,), daemon=True); early.start()\n"
        "chosen = pin(1); seen = [os.sched_getaffinity(early.native_id)]\n"
        "late = threading.Thread(target=lambda: seen.append(os.sched_getaffinity(0))); "
        "late.start(); late.join()\n"
        "print(chosen, seen == [set(chosen)] * 2, cores())"
    )
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True
    )
    assert re.fullmatch(r"\(\d+,\) True 1\n", done.stdout), done.stdout


def test_less_is_done_where_pairs_take_too_long_and_more_again_later() -> None:
    budget = Budget(0.1)
    shrinks = []
    for _ in range(60):
        budget.took({1: 0.3, 2: 0.15, 4: 0.02}[budget.shrink])
        shrinks.append(budget.shrink)
    assert shrinks[3:5] == [1, 2]
    assert "matched at 1/4 of the size to keep within 100 ms per pair" in text_after(
        0.1, (0.3,) * 5 + (0.15,) * 5
    )
    assert "(300 ms at full size)" in text_after(0.1, (0.3,) * 5)
    assert max(shrinks) == 4
    for _ in range(400):
        budget.took(0.02)
    assert budget.shrink == 1
    assert budget.text == ""
    assert [Budget(None).took(9.0) for _ in range(9)] == [None] * 9


def text_after(budget_s: float, seconds: tuple[float, ...]) -> str:
    budget = Budget(budget_s)
    for took in seconds:
        budget.took(took)
    return budget.text


@pytest.mark.parametrize("shrink", [2, 4])
def test_a_reduced_pair_has_nearly_the_same_ranges(make_dive, shrink: int) -> None:
    dive = make_dive(1)
    pipeline = Pipeline(_rig(dive.root), RunConfig())
    pair = watch_dive(dive.root)
    rectified = pipeline.rectify(pipeline.read(pair))
    full = pipeline.match(rectified)
    found = ReducedMatcher(
        pipeline.rectification.matching_pair, pipeline.config.matching, None, shrink
    ).match(rectified)
    both = np.isfinite(full.range_m) & np.isfinite(found.range_m)
    assert found.range_m.shape == full.range_m.shape
    assert both.mean() > 0.5
    assert np.median(np.abs(found.range_m / full.range_m - 1)[both]) < 0.02
    assert np.median(np.abs(found.disparity - full.disparity)[both]) < 1.0


def watch_dive(root: Path) -> Pair:
    found = FolderWatch(root / "L", root / "R", InputConfig()).newest()
    assert found is not None
    return found


def test_a_picture_of_ranges_is_bright_where_it_is_near_and_black_where_nothing_is_known() -> None:
    range_m = np.tile(np.linspace(1, 3, 64, dtype=np.float32), (48, 1))
    range_m[:8] = np.nan
    picture, near_m, far_m = range_picture(range_m)
    assert not picture[:8].any()
    assert picture[20, 4].sum() > picture[20, 32].sum() > picture[20, -5].sum() > 0
    assert 1 < near_m < 1.1 and 2.9 < far_m < 3
    nothing = range_picture(range_m[:8])
    assert not nothing[0].any() and np.isnan(nothing[1:]).all()
