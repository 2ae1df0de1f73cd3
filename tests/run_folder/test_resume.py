"""Killed, interrupted, starved of disk: nothing half written, nothing lost, and the next run ends
as if nothing had been.
"""

import csv
import json
import os
import random
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import cv2
import pytest
from conftest import AtPair, contents

from stereo_seecolor.color.corrector import Corrector
from stereo_seecolor.commands.run import run
from stereo_seecolor.dive.run_options import RunOptions
from stereo_seecolor.errors import InputError, OutputError
from stereo_seecolor.inputs.images import read_image, read_range_map
from stereo_seecolor.run_folder.finished_run import open_run
from stereo_seecolor.run_folder.manifest import FrameRecord, StageRecord

ROOT = Path(__file__).resolve().parents[2]
PROGRAM = str(Path(sys.executable).parent / "stereo-seecolor")


@pytest.fixture(autouse=True)
def heed_interrupts() -> Iterator[None]:
    """Ctrl-C works, also where the tests are run in the background of a script, whose shell has it
    ignored.
    """
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


def assert_whole(out: Path) -> None:
    """Every visible file can be read to its end."""
    for path in out.rglob("*"):
        if path.name.startswith(".writing-") or path.is_dir():
            continue
        if path.suffix == ".png":
            read_image(path)
        elif path.suffix == ".tiff" and path.parent.name == "range":
            read_range_map(path)
        elif path.suffix == ".tiff":
            assert cv2.imread(str(path), cv2.IMREAD_UNCHANGED) is not None
        elif path.suffix == ".json":
            json.loads(path.read_text())
        elif path.suffix == ".ply":
            header, _, body = path.read_bytes().partition(b"end_header\n")
            assert len(body) == 15 * int(header.split(b"element vertex ")[1].split()[0])


def run_in_process(dive, out: Path, listener=None):  # type: ignore[no-untyped-def]
    options = RunOptions(workers=2, listener=listener) if listener else RunOptions(workers=2)
    return run(dive.root / "L", dive.root / "R", dive.root / "cam.yaml", out, options=options)


@pytest.mark.slow
def test_kills_at_random_instants_change_nothing(finished_run, make_dive, tmp_path, cli) -> None:
    dive = make_dive(10)
    words = [PROGRAM, *dive.command(tmp_path / "killed", "--workers", "2")]
    rng = random.Random(5)
    for _ in range(4):
        with subprocess.Popen(
            words, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        ) as process:
            deadline = time.monotonic() + 20
            while (
                not (tmp_path / "killed/range").exists()
                and process.poll() is None
                and time.monotonic() < deadline
            ):
                time.sleep(0.005)
            time.sleep(rng.uniform(0, 0.15))
            process.kill()
        assert_whole(tmp_path / "killed")
    assert cli(*words[1:])[0] == 0
    assert contents(tmp_path / "killed") == contents(finished_run(10))
    assert not list((tmp_path / "killed").rglob(".writing-*"))
    rows = list(csv.DictReader((tmp_path / "killed/frames.csv").read_text().splitlines()))
    assert [row["status"] for row in rows] == ["ok"] * 10


KILLED_AT_THE_END = """
import os, signal, sys
from stereo_seecolor.cli import main
from stereo_seecolor.commands import run_session
run_session.write_reports = lambda *_: os.kill(os.getpid(), signal.SIGKILL)
main()
"""


@pytest.mark.slow
@pytest.mark.posix
def test_a_kill_in_the_first_run_of_a_changed_setting_leaves_nothing_that_passes_for_a_run(
    copy_run, finished_run, make_dive, tmp_path, cli
) -> None:
    """All frames are of the new settings then, and run.json is of the old ones."""
    dive, out = make_dive(2), tmp_path / "out"
    copy_run(out, 2)
    words = dive.command(out, "--set", "matching.min_confidence=0.5")
    killed = subprocess.run(
        [sys.executable, "-c", KILLED_AT_THE_END, *words], cwd=ROOT, capture_output=True
    )
    assert killed.returncode == -signal.SIGKILL
    code, _, said = cli("fuse", str(out))
    assert code == 1 and said.count("\n") == 1
    assert "a run with other settings was killed" in said and "run the same command again" in said
    with pytest.raises(InputError, match="was killed"):
        open_run(out)
    code, printed, _ = cli(*words)
    assert code == 0 and "2 of them kept" in printed
    assert open_run(out).config.matching.min_confidence == 0.5
    assert contents(out) == contents(finished_run(2, "matching.min_confidence=0.5"))


@pytest.mark.slow
def test_what_a_killed_worker_left_of_a_record_costs_no_frame_its_files(
    finished_run, make_dive, tmp_path
) -> None:
    """The temporary file of a record names its frame's files: taken for a frame that has left the
    dive, it would cost it them.
    """
    dive, out = make_dive(3), tmp_path / "out"

    def lose() -> None:
        record = out / ".state/frames/0000.json"
        (record.parent / ".writing-c3104a26564-9-0000.json").write_bytes(record.read_bytes())

    run_in_process(dive, out, AtPair(4, lose))
    assert contents(out) == contents(finished_run(3))
    assert not list(out.rglob(".writing-*"))
    assert run_in_process(dive, out).kept == 3


@pytest.mark.slow
@pytest.mark.parametrize("at", [2, 7])
def test_interrupt_tells_what_was_done_and_resumes(finished_run, make_dive, tmp_path, at) -> None:
    dive, out = make_dive(5), tmp_path / "out"
    summary = run_in_process(dive, out, AtPair(at, lambda: os.kill(os.getpid(), signal.SIGINT)))
    assert summary.stopped
    assert not summary.all_done
    assert json.loads((out / "run.json").read_text())["totals"]["stopped"]
    assert_whole(out)
    assert run_in_process(dive, out).all_done
    assert contents(out) == contents(finished_run(5))


@pytest.mark.posix
@pytest.mark.slow
def test_disk_full_is_one_line_and_resumable(make_dive, tmp_path, cli) -> None:
    dive, out = make_dive(3), tmp_path / "out"

    def no_room() -> None:
        import resource

        resource.setrlimit(resource.RLIMIT_FSIZE, (60_000, 60_000))
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)

    words = [PROGRAM, *dive.command(out), "--progress", "none"]
    failed = subprocess.run(words, capture_output=True, text=True, preexec_fn=no_room)
    assert failed.returncode == 1
    assert "cannot be written: File too large" in failed.stderr
    assert failed.stderr.count("\n") == 1
    assert_whole(out)
    assert cli(*words[1:])[0] == 0
    assert len(list((out / "corrected").iterdir())) == 3


@pytest.mark.slow
def test_output_folder_lost_midway(make_dive, tmp_path, monkeypatch) -> None:
    dive, out = make_dive(4), tmp_path / "out"

    def lose() -> None:
        for attempt in range(100):  # a worker may make the folder again in between
            (out / "range").rename(tmp_path / f"lost-{attempt}")
            try:
                (out / "range").touch(exist_ok=False)
            except FileExistsError:
                continue
            return

    with pytest.raises(OutputError, match="cannot be written"):
        run_in_process(dive, out, AtPair(1, lose))
    (out / "range").unlink()
    assert run_in_process(dive, out).all_done


@pytest.mark.slow
def test_inputs_vanishing_midway_are_named(make_dive, tmp_path) -> None:
    dive, out = make_dive(6), tmp_path / "out"
    summary = run_in_process(dive, out, AtPair(2, lambda: (dive.root / "L/0005.png").unlink()))
    failed = [row for row in summary.rows if row.status == "failed"]
    assert [row.name for row in failed] == ["0005"]
    assert "L/0005.png: cannot be read: No such file" in failed[0].error
    assert summary.count("ok") == 5


@pytest.mark.slow
def test_read_only_inputs_and_links(make_dive, tmp_path) -> None:
    dive = make_dive(2)
    linked = tmp_path / "linked dive é"
    (linked / "L").mkdir(parents=True)
    (linked / "R").symlink_to(dive.root / "R")
    for path in (dive.root / "L").iterdir():
        path.chmod(0o400)
        (linked / "L" / path.name.upper()).symlink_to(path)
    summary = run(linked / "L", linked / "R", dive.root / "cam.yaml", tmp_path / "out é")
    assert summary.all_done


@pytest.mark.slow
def test_kept_tables_that_are_damaged_are_counted_again(copy_run, make_dive, tmp_path) -> None:
    dive, out = make_dive(2), tmp_path / "out"
    copy_run(out, 2)
    before = contents(out)
    cut, wrong = sorted((out / ".state" / "tables").iterdir())
    cut.write_bytes(cut.read_bytes()[:-20])
    wrong.write_bytes(wrong.read_bytes()[:64] + b"no table at all")
    (out / "water.json").unlink()
    run_in_process(dive, out)
    assert contents(out) == before


@pytest.mark.slow
def test_a_rerun_fits_no_water_again_unless_something_changed(
    make_dive, tmp_path, monkeypatch
) -> None:
    dive, out, fits = make_dive(3), tmp_path / "out", []
    fit = Corrector.fit
    monkeypatch.setattr(Corrector, "fit", lambda *arguments: fits.append(1) or fit(*arguments))
    notes = run_in_process(dive, out).notes
    before, first = contents(out), len(fits)
    assert run_in_process(dive, out).notes == notes
    assert notes[1].startswith("light: no two frames show the same spots")
    assert len(fits) == first
    (out / ".state" / "fit.kept").write_text("{}")
    run_in_process(dive, out)
    assert len(fits) > first
    assert contents(out) == before
    first = len(fits)
    monkeypatch.setattr(
        "stereo_seecolor.dive.passes.sources_digest", lambda file: f"newer {file.name}"
    )
    run_in_process(dive, out)
    assert len(fits) > first, "an update of the code that fits"
    image = cv2.imread(str(dive.root / "L" / "0001.png"))
    cv2.imwrite(str(dive.root / "L" / "0001.png"), image // 2)
    second = len(fits)
    run_in_process(dive, out)
    assert len(fits) > second
    assert contents(out)["water.json"] != before["water.json"]


def test_what_was_made_of_an_earlier_stage_is_made_again() -> None:
    """New ranges end the colors and the page of a frame; a new page ends nothing."""
    frame = FrameRecord("f")
    for stage in ("range", "corrected", "page"):
        frame = frame.with_stage(stage, StageRecord("old"))
    assert frame.with_stage("page", StageRecord("new")).stages.keys() == frame.stages.keys()
    assert frame.with_stage("corrected", StageRecord("new")).stages.keys() == {"range", "corrected"}
    assert frame.with_stage("range", StageRecord("new")).stages.keys() == {"range"}
