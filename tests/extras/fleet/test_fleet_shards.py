"""Shards of a dive on machines that know nothing of each other, and their results as one."""

import csv
import json
import os
from dataclasses import replace
from pathlib import Path

import pytest
from conftest import contents

from stereo_seecolor.checks.changes import DiveChange
from stereo_seecolor.checks.verdict import RANGES, DiveVerdict
from stereo_seecolor.commands import stereo_inputs
from stereo_seecolor.commands.run import run
from stereo_seecolor.compute.shard import Shard
from stereo_seecolor.config import RunConfig
from stereo_seecolor.dive.run_options import RunOptions
from stereo_seecolor.errors import InputError, OutputError
from stereo_seecolor.extras.fleet.campaign_states import DiveState, save_states
from stereo_seecolor.extras.fleet.forecast import Forecast
from stereo_seecolor.extras.fleet.merge import merge
from stereo_seecolor.extras.fleet.plan import plan
from stereo_seecolor.extras.fleet.status import status
from stereo_seecolor.extras.fleet.texts import status_text
from stereo_seecolor.run_folder import run_progress
from stereo_seecolor.run_folder.run_progress import ExpectedPasses


@pytest.mark.parametrize(("items", "of"), [(10, 3), (2, 5), (0, 2), (100, 7)])
def test_shards_are_neighbors_of_about_one_size_and_together_all(items: int, of: int) -> None:
    parts = [list(Shard(number, of).part(range(items))) for number in range(1, of + 1)]
    assert [item for part in parts for item in part] == list(range(items))
    assert max(map(len, parts)) - min(map(len, parts)) <= 1


@pytest.mark.parametrize("text", ["0/2", "3/2", "1", "1/0", "a/b", "1/2/3"])
def test_what_is_no_shard_is_refused(cli, text: str) -> None:
    code, _, said = cli("run", "--left", "L", "--right", "R", "--calib", "C", "--shard", text)
    assert code == 2
    assert "for example 2/8" in said


def sharded(
    dive, tmp_path: Path, of: int = 2, config: RunConfig | None = None, water: Path | None = None
) -> list[Path]:
    sides = (dive.root / "L", dive.root / "R", dive.root / "cam.yaml")
    outs = [tmp_path / f"part{number}" for number in range(1, of + 1)]
    for number, out in enumerate(outs, 1):
        run(*sides, out, config, RunOptions(shard=Shard(number, of), water=water))
    return outs


def whole(dive, tmp_path: Path, config: RunConfig | None = None) -> dict[str, bytes]:
    run(dive.root / "L", dive.root / "R", dive.root / "cam.yaml", tmp_path / "whole", config)
    return contents(tmp_path / "whole")


@pytest.mark.slow
def test_merged_shards_are_the_same_bytes_as_one_run_and_a_run_into_them_has_nothing_to_do(
    make_dive, tmp_path
) -> None:
    dive = make_dive(5)
    (dive.root / "R/0003.png").write_bytes(b"")
    (dive.root / "L/alone.png").write_bytes((dive.root / "L/0000.png").read_bytes())
    parts = sharded(dive, tmp_path)
    assert not (parts[0] / "corrected").exists()
    summary = merge(parts, tmp_path / "merged")
    assert (summary.count("ok"), summary.count("failed"), summary.count("unpaired")) == (4, 1, 1)
    assert contents(tmp_path / "merged") == whole(dive, tmp_path)
    again = run(dive.root / "L", dive.root / "R", dive.root / "cam.yaml", tmp_path / "merged")
    assert again.kept == 4
    assert (parts[0] / "range/0000.tiff").samefile(tmp_path / "merged/range/0000.tiff")


@pytest.mark.slow
def test_shards_of_a_folder_that_grew_in_between_are_not_merged(make_dive, tmp_path) -> None:
    """Each is consistent in itself, and pairs between them would be missing without a word."""
    dive = make_dive(5)
    sides = (dive.root / "L", dive.root / "R", dive.root / "cam.yaml")
    late = [dive.root / side / "0004.png" for side in "LR"]
    for path in late:
        path.rename(dive.root / f"{path.parent.name}.png")
    run(*sides, tmp_path / "1", options=RunOptions(shard=Shard(1, 2)))
    for path in late:
        (dive.root / f"{path.parent.name}.png").rename(path)
    run(*sides, tmp_path / "2", options=RunOptions(shard=Shard(2, 2)))
    with pytest.raises(
        InputError, match=r"1 is a shard of 4 pairs, and .*2 of 5: images were added"
    ):
        merge([tmp_path / "1", tmp_path / "2"], tmp_path / "merged")
    run(*sides, tmp_path / "1", options=RunOptions(shard=Shard(1, 2)))
    assert merge([tmp_path / "1", tmp_path / "2"], tmp_path / "merged").count("ok") == 5


@pytest.mark.slow
def test_a_shard_has_no_page_and_no_map(make_dive, cli, tmp_path) -> None:
    dive, out = make_dive(3), tmp_path / "1"
    sides = ("--left", dive.root / "L", "--right", dive.root / "R")
    words = ("--calib", dive.root / "cam.yaml", "--out", out, "--shard", "1/2")
    code, printed, _ = cli("run", *sides, *words)
    assert (code, "index.html" in printed, (out / "index.html").exists()) == (0, False, False)
    code, _, said = cli("fuse", out)
    assert (code, "it is a shard of a dive: join all shards with" in said) == (1, True)


@pytest.mark.slow
@pytest.mark.parametrize("lock", ["auto", "frame"])
def test_shards_corrected_apart_with_the_water_of_all(make_dive, tmp_path, lock: str) -> None:
    dive = make_dive(4)
    (dive.root / "R/0002.png").write_bytes(b"")
    config = RunConfig.model_validate({"color": {"lock": lock}})
    parts = sharded(dive, tmp_path, 3, config)
    merge(parts, tmp_path / "merged", fit_only=True)
    assert not (tmp_path / "merged/corrected").exists()
    sharded(dive, tmp_path, 3, config, tmp_path / "merged/water.json")
    summary = merge(parts, tmp_path / "merged")
    assert (summary.kept, summary.count("failed")) == (3, 1)
    assert contents(tmp_path / "merged") == whole(dive, tmp_path, config)


@pytest.mark.slow
def test_parts_run_elsewhere_with_other_waters_are_merged_with_a_note(
    make_dive, tmp_path, cli, monkeypatch
) -> None:
    dive = make_dive(4)
    given = json.loads(_fitted(sharded(dive, tmp_path)[0], tmp_path).read_text())
    monkeypatch.chdir(dive.root)
    for number, red in ((1, 0.12), (2, 0.18)):
        given["water"]["beta"][0] = red
        water = tmp_path / f"water{number}.json"
        water.write_text(json.dumps(given))
        options = RunOptions(shard=Shard(number, 2), water=water)
        run(Path("L"), Path("R"), Path("cam.yaml"), tmp_path / f"apart{number}", None, options)
    monkeypatch.chdir(tmp_path)
    code, said, _ = cli("merge", "apart1", "apart2", "--out", "merged")
    assert code == 0 and "the parts were corrected with different water parameters" in said


@pytest.mark.slow
def test_parts_that_do_not_belong_together_are_refused(make_dive, tmp_path) -> None:
    dive = make_dive(4)
    one, two = sharded(dive, tmp_path)
    sides = (dive.root / "L", dive.root / "R", dive.root / "cam.yaml")
    second = RunOptions(shard=Shard(2, 2))
    with pytest.raises(OutputError):
        run(*sides, one, options=second)
    other = RunConfig.model_validate({"color": {"lock": "survey"}})
    run(*sides, tmp_path / "other", other, second)
    with pytest.raises(InputError, match="other settings or another rig"):
        merge([one, tmp_path / "other"], tmp_path / "merged")
    run(*sides, tmp_path / "corrected", options=replace(second, water=_fitted(one, tmp_path)))
    with pytest.raises(InputError, match="has no water yet"):
        merge([one, tmp_path / "corrected"], tmp_path / "merged")
    for side in "LR":
        (dive.root / side / "0003.png").write_bytes((dive.root / side / "0002.png").read_bytes())
    run(*sides, tmp_path / "changed", options=second)
    with pytest.raises(InputError, match="two different pairs '0003'"):
        merge([one, two, tmp_path / "changed"], tmp_path / "merged")
    with pytest.raises(InputError, match="nothing: "):
        merge([one, tmp_path / "nothing"], tmp_path / "merged")
    assert not (tmp_path / "merged").exists()


def _fitted(part: Path, tmp_path: Path) -> Path:
    merge([part], tmp_path / "fitted", fit_only=True, partial=True)
    return tmp_path / "fitted/water.json"


@pytest.mark.slow
def test_the_state_of_runs(make_dive, tmp_path, cli, monkeypatch) -> None:
    monkeypatch.setattr(run_progress, "EVERY_S", 0.0)
    dive = make_dive(3)
    (dive.root / "R/0001.png").write_bytes(b"")
    seen = []

    class Watcher:
        def begin(self, stage: str, total: int) -> None:
            pass

        def advance(self, row) -> None:
            seen.append(status(tmp_path / "out"))

    run(
        dive.root / "L",
        dive.root / "R",
        dive.root / "cam.yaml",
        tmp_path / "out",
        options=RunOptions(listener=Watcher()),
    )
    assert {found.state for found in seen} == {"running"}
    assert f"process {os.getpid()}" in seen[0].writer
    assert seen[-1].stage == "colors"
    assert seen[-1].remaining_s is not None
    assert (seen[0].stage, seen[0].to_come[-1], seen[0].rests_on) == (
        "ranges",
        "colors",
        "the usual times of the passes",
    )
    assert seen[0].run_remaining_s > seen[0].remaining_s
    done = status(tmp_path / "out")
    assert (done.state, done.done, done.failed, done.left) == ("complete", 2, 1, 0)
    assert "is empty" in done.failures[0][0]
    code, printed, _ = cli("status", tmp_path / "out")
    assert code == 0
    assert "complete" in printed
    assert "is empty" in printed


@pytest.mark.slow
def test_folders_without_a_run_are_told_apart_and_dives_of_a_campaign_found(
    make_dive, tmp_path, cli
) -> None:
    dive = make_dive(2)
    run(dive.root / "L", dive.root / "R", dive.root / "cam.yaml", tmp_path / "all/one")
    states = {"one": DiveState("one", "done"), "two": DiveState("two", "not begun")}
    save_states(tmp_path / "all", states)
    code, printed, _ = cli("status", tmp_path / "all")
    assert (code, "holds no" in printed) == (0, False)
    code, printed, _ = cli("status", tmp_path / "all", dive.root)
    assert (code, f"{dive.root}: holds no finished run" in printed) == (3, True)
    assert [line.split()[1] for line in printed.splitlines()[1:]] == ["complete", "no", "no"]
    code, _, said = cli("status", dive.root)
    assert code == 1
    assert str(dive.root) in said


@pytest.mark.slow
def test_a_merge_that_stops_at_the_water_expects_no_correction(make_dive, tmp_path) -> None:
    dive = make_dive(2)
    seen = []

    class Watcher:
        def begin(self, stage: str, total: int) -> None:
            pass

        def advance(self, row) -> None:
            seen.append(list(status(tmp_path / "whole").to_come))

    merge(
        sharded(dive, tmp_path), tmp_path / "whole", RunOptions(listener=Watcher()), fit_only=True
    )
    assert seen == [["waters"], ["waters"], [], []]  # of two pairs: ranges, then waters


def test_a_run_ends_when_its_passes_have_taken_what_they_are_expected_to() -> None:
    expected = ExpectedPasses({"ranges": 2.0, "light": 1.0, "colors": 3.0}, planned=True)
    ranges = Forecast("ranges", 100, 50, 0, 1000.0, 1100.0, 50, [], expected)  # as fast as expected
    assert ranges.ends_s == 1200
    assert ranges.run_ends_s == 1200 + 100 * (1 + 3)
    # by two workers
    light = Forecast("light", 100, 0, 0, 1000.0, 1000.0, 0, [("ranges", 100, 100.0)], expected)
    assert light.ends_s is None
    assert light.run_ends_s == 1000 + 100 * (1 + 3) / 2
    # nothing tells how fast it goes
    kept = Forecast("ranges", 100, 50, 0, 1000.0, 1001.0, 0, [], expected)
    assert kept.run_ends_s is None
    assert kept.to_come == ["light", "colors"]
    tiles = Forecast("tiles", 10, 5, 0, 1000.0, 1010.0, 5, [], ExpectedPasses({}))
    assert (tiles.ends_s, tiles.run_ends_s) == (1020, None)


@pytest.mark.slow
def test_the_end_of_a_run_follows_from_its_plan(make_dive, tmp_path, cli) -> None:
    dive, out = make_dive(2), tmp_path / "out"
    plan(dive.root / "L", dive.root / "R", dive.root / "cam.yaml", out=out)
    told = []

    class Watcher:
        def begin(self, stage: str, total: int) -> None:
            told.append(status(out))

        def advance(self, row) -> None:
            pass

    run(
        dive.root / "L",
        dive.root / "R",
        dive.root / "cam.yaml",
        out,
        options=RunOptions(listener=Watcher()),
    )
    assert (told[0].state, told[0].stage) == ("running", "")
    assert told[1].rests_on == "the plan"
    assert "page and map not counted; by the plan)" in status_text(told)


@pytest.mark.slow
def test_a_killed_run_is_told_from_one_under_way(make_dive, tmp_path) -> None:
    dive = make_dive(2)
    out = tmp_path / "out"
    run(dive.root / "L", dive.root / "R", dive.root / "cam.yaml", out)
    manifest = out / ".state/manifest.json"
    manifest.write_text(json.dumps({**json.loads(manifest.read_text()), "state": "running"}))
    assert replace(status(out), remaining_s=None).state == "killed"


@pytest.mark.slow
def test_a_merge_names_the_shards_that_it_lacks(make_dive, tmp_path, cli) -> None:
    dive, out = make_dive(4), tmp_path / "merged"
    one, _, three = sharded(dive, tmp_path, 3)
    code, _, said = cli("merge", one, three, "--out", out)
    assert code == 1
    assert "shard 2/3 is missing: run it and give all 3; --partial" in said
    assert not out.exists()

    code, printed, _ = cli("merge", one, three, "--out", out, "--partial")
    assert code == 3
    assert "only a part of the dive: shard 2/3 is missing" in printed
    assert json.loads((out / "run.json").read_text())["totals"]["missing_shards"] == ["2/3"]
    page = (out / "index.html").read_text()
    assert "shard 2/3 are missing" in page
    assert "Good: no problem was detected" not in page


@pytest.mark.slow
def test_shards_and_their_merge_keep_that_ranges_are_wrong_and_which_pairs_are_left_out(
    make_dive, tmp_path, cli, monkeypatch
) -> None:
    note, change = "calibration: ranges are off by half", DiveChange("", frozenset({"0003"}))
    monkeypatch.setattr(stereo_inputs, "check_rig", lambda *_: DiveVerdict((note,), RANGES))
    monkeypatch.setattr(stereo_inputs, "find_change", lambda *_: change)
    parts = sharded(make_dive(4), tmp_path)
    with (parts[1] / "frames.csv").open(newline="") as table:
        statuses = {row["name"]: row["status"] for row in csv.DictReader(table)}
    assert statuses == {"0002": "ok", "0003": "failed"}
    code, printed, _ = cli("merge", parts[0], "--out", tmp_path / "one", "--partial", "--fit-only")
    assert code == 3
    assert " ".join(printed.split()).count(note) == 1
    summary = merge(parts, tmp_path / "merged", fit_only=True)
    assert summary.wrong == RANGES
    assert [row.name for row in summary.rows if row.status == "failed"] == ["0003"]
    totals = json.loads((tmp_path / "merged/run.json").read_text())["totals"]
    assert totals["ranges_are_wrong"]
    assert totals["notes"].count(note) == 1


@pytest.mark.slow
def test_a_merge_takes_shards_of_one_cut_each_once(make_dive, tmp_path, cli) -> None:
    dive = make_dive(4)
    one, two = sharded(dive, tmp_path)
    sides = (dive.root / "L", dive.root / "R", dive.root / "cam.yaml")
    run(*sides, tmp_path / "third", options=RunOptions(shard=Shard(3, 3)))
    for parts, message in (
        ([one, one, two], f"{one}: is given twice"),
        (
            [one, tmp_path / "third"],
            "is shard 1/2, and .*third is shard 3/3: merge only shards of one division",
        ),
    ):
        with pytest.raises(InputError, match=message):
            merge(parts, tmp_path / "merged", partial=True)
    assert not (tmp_path / "merged").exists()


@pytest.mark.slow
def test_a_png_with_a_jpeg_of_one_name_is_named_once_in_a_merge(make_dive, tmp_path, cli) -> None:
    dive = make_dive(4)
    (dive.root / "L/0000.jpg").write_bytes((dive.root / "L/0000.png").read_bytes())
    code, printed, _ = cli("merge", *sharded(dive, tmp_path), "--out", tmp_path / "merged")
    assert code == 3
    (line,) = [
        line
        for line in printed.splitlines()
        if line.startswith("unpaired: ") and "0000.jpg: " in line
    ]
    assert line.endswith(
        "0000.jpg: several files are called '0000' (0000.jpg, 0000.png): keep one of them, or "
        "name a pattern such as 'L/*.png'"
    )
    assert line.count(f"{dive.root / 'L/0000.jpg'}: ") == 1
