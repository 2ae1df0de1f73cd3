"""Many dives, one of them bad; and what a dive will cost."""

import csv
import json
import shutil
from pathlib import Path
from types import SimpleNamespace

import pytest

from stereo_seecolor.cli.result_texts import run_text
from stereo_seecolor.commands.run import run
from stereo_seecolor.config.file import load_config
from stereo_seecolor.dive.run_options import RunOptions
from stereo_seecolor.errors import ColorError, ConfigError, InputError
from stereo_seecolor.extras.fleet import campaign as module
from stereo_seecolor.extras.fleet.campaign import CampaignFile, campaign
from stereo_seecolor.extras.fleet.plan import plan
from stereo_seecolor.mapping.survey_map import MapSummary
from stereo_seecolor.records import FrameRow
from stereo_seecolor.run_folder.frame_table import RunSummary


def write(file: Path, *dives: str, more: str = "") -> Path:
    file.write_text(f"out: results\n{more}dives:\n" + "".join(f"  - {dive}\n" for dive in dives))
    return file


SIDES = "left: dive/L, right: dive/R, calib: dive/cam.yaml"


@pytest.mark.slow
def test_a_bad_dive_costs_no_other_and_only_it_is_run_again(make_dive, tmp_path) -> None:
    dive = make_dive(2)
    (dive.root / "R/0001.png").rename(dive.root / "later.png")
    (dive.root / "R/0001.png").write_bytes(b"")
    entries = (f"{{name: gone, {SIDES.replace('dive/L', 'nowhere')}}}", f"{{name: part, {SIDES}}}")
    file = write(
        tmp_path / "campaign.yaml",
        *entries,
        more="settings: {color.lock: survey, output.preset: no-clouds}\n",
    )
    result = campaign(file)
    assert [(found.state, found.ok, found.failed) for found in result.dives] == [
        ("failed", 0, 0),
        ("some pairs failed", 1, 1),
    ]
    assert "nowhere" in result.dives[0].error
    assert not (tmp_path / "results/part/clouds").exists()
    (dive.root / "later.png").replace(dive.root / "R/0001.png")
    again = campaign(file, only_failed=True)
    assert [found.state for found in again.dives] == ["failed", "done"]
    done = campaign(file, only_failed=True)
    assert done.dives[1] == again.dives[1]  # skipped, its seconds among the rest
    with result.table.open() as table:
        assert [row["state"] for row in csv.DictReader(table)] == ["failed", "done"]
    assert not done.all_done
    file.write_text(file.read_text().replace("{name: part,", "{name: part, water: w.json,"))
    asked = campaign(file, only_failed=True)  # of a dive whose entry changed, as it is now
    assert "w.json" in asked.dives[1].error


def test_a_mistyped_setting_is_named_before_the_first_dive(tmp_path) -> None:
    entries = [f"{{name: {name}, {SIDES}, settings: {{{key}: 6}}}}" for name, key in SETTINGS]
    with pytest.raises(ConfigError, match=r"yaml: dive 'tuesday': .*matching\.max_range_mm"):
        campaign(write(tmp_path / "campaign.yaml", *entries))
    assert not (tmp_path / "results").exists()


SETTINGS = (("monday", "matching.max_range_m"), ("tuesday", "matching.max_range_mm"))


@pytest.mark.slow
@pytest.mark.parametrize("encoding", ["auto", "linear"])
def test_dives_of_a_site_share_the_water_that_one_run_over_all_their_pairs_has(
    make_dive, tmp_path, encoding: str
) -> None:
    whole = make_dive(4)
    for number in range(4):
        for side in "LR":
            place = tmp_path / "ab"[number // 2] / side / f"{number}.png"
            place.parent.mkdir(parents=True, exist_ok=True)
            place.symlink_to(whole.root / side / f"{number:04d}.png")
    entries = [
        f"{{name: {name}, site: reef, left: {name}/L, right: {name}/R, calib: dive/cam.yaml}}"
        for name in "ab"
    ]
    gone = f"{{name: gone, site: reef, {SIDES.replace('dive/L', 'nowhere')}}}"
    more = f"settings: {{color.input_encoding: {encoding}}}\n"
    result = campaign(write(tmp_path / "campaign.yaml", *entries, gone, more=more))
    assert [found.state for found in result.dives] == ["done", "done", "failed"]
    run(
        whole.root / "L",
        whole.root / "R",
        whole.root / "cam.yaml",
        tmp_path / "whole",
        load_config(None, ["color.lock=survey", f"color.input_encoding={encoding}"]),
    )
    expected = json.loads((tmp_path / "whole/water.json").read_bytes())["water"]
    for name in "ab":
        assert (
            json.loads((tmp_path / "results" / name / "water.json").read_bytes())["water"]
            == expected
        )
    again = campaign(tmp_path / "campaign.yaml", only_failed=True)
    assert again.dives[:2] == result.dives[:2]


class Interrupts:
    """A person who presses Ctrl-C at the first pair of a stage."""

    def __init__(self, stage: str) -> None:
        self._stage, self._now = stage, ""

    def begin(self, stage: str, total: int) -> None:
        self._now = stage

    def advance(self, row: object) -> None:
        if self._now == self._stage:
            raise KeyboardInterrupt


@pytest.mark.slow
def test_a_campaign_that_is_stopped_says_so_of_its_dive_and_goes_on(make_dive, tmp_path) -> None:
    make_dive(2)
    entries = [
        f"{{name: a, {SIDES}}}",
        f"{{name: b, site: s, {SIDES}}}",
        f"{{name: c, site: s, {SIDES}}}",
    ]
    file = write(tmp_path / "campaign.yaml", *entries)
    listener = Interrupts("colors")
    assert [found.state for found in campaign(file, RunOptions(listener=listener)).dives] == [
        "stopped",
        "not begun",
        "not begun",
    ]
    campaign(write(tmp_path / "one.yaml", entries[0]))
    # in the fit of the site's water
    stopped = campaign(file, RunOptions(listener=Interrupts("ranges")), only_failed=True)
    assert [found.state for found in stopped.dives] == ["done", "stopped", "not begun"]
    with stopped.table.open() as table:
        assert [row["state"] for row in csv.DictReader(table)] == ["done", "stopped", "not begun"]
    assert campaign(file, only_failed=True).all_done


@pytest.mark.slow
def test_a_dive_whose_map_fails_has_its_frames_and_the_reason(
    make_dive, tmp_path, monkeypatch
) -> None:
    make_dive(1)
    (tmp_path / "nav.tum").write_text("no number\n")
    file = write(tmp_path / "campaign.yaml", f"{{name: a, poses: nav.tum, {SIDES}}}")
    (found,) = campaign(file).dives
    assert (found.state, found.ok) == ("failed", 1)
    assert "nav.tum" in found.error
    assert (tmp_path / "results/records/a.json").is_file()

    def stopped(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(module, "fuse", stopped)
    (found,) = campaign(file).dives
    assert (found.state, found.ok) == ("stopped", 1)


def test_a_dive_whose_numbers_or_map_are_not_right_is_not_done(
    make_dive, tmp_path, monkeypatch
) -> None:
    """As run and fuse alone end with exit code 3 then."""
    make_dive(1)
    made = {
        "wrong": RunSummary((row("ok"),), wrong=frozenset({"ranges"})),
        "alone": RunSummary((row("ok"), row("unpaired"))),
        "map": RunSummary((row("ok"),)),
        "good": RunSummary((row("ok"),)),
    }
    navigation = SimpleNamespace(relative_poses=3, fits=False, blurred=False, advice="in feet")
    mapped = MapSummary(5, 4, (2, 2), ("x",), (), 9, 1.0, (), navigation)
    monkeypatch.setattr(module, "run", lambda *given: made[given[3].name])
    monkeypatch.setattr(module, "fuse", lambda *_: mapped)
    monkeypatch.setattr(module, "report", lambda *_: None)
    monkeypatch.setattr(module, "write_records", lambda *_: None)
    entries = [f"{{name: {name}, fuse: {str(name == 'map').lower()}, {SIDES}}}" for name in made]
    result = campaign(write(tmp_path / "campaign.yaml", *entries))
    assert [(found.state, found.error) for found in result.dives] == [
        ("problems", "ranges are wrong, as its notes say"),
        ("some pairs failed", "1 file without a partner"),
        (
            "problems",
            "1 of 5 frames are not in the map; the map is in 2 parts; in feet",
        ),
        ("done", ""),
    ]
    assert not result.all_done


def row(status: str) -> FrameRow:
    return FrameRow("a", status, "a.png", "b.png")


@pytest.mark.slow
def test_a_dive_that_was_done_is_run_again_where_its_results_are_gone(make_dive, tmp_path) -> None:
    make_dive(1)
    (tmp_path / "old").mkdir()
    sides = SIDES.replace("dive/", "../dive/")
    entries = [f"{{name: {name}, {sides}}}" for name in "ab"]
    campaign(write(tmp_path / "old" / "campaign.yaml", *entries))
    (tmp_path / "old").rename(tmp_path / "moved")
    shutil.rmtree(tmp_path / "moved/results/a")
    again = campaign(tmp_path / "moved/campaign.yaml", only_failed=True)
    assert again.all_done
    assert [found.out for found in again.dives] == [
        str(tmp_path / "moved/results" / name) for name in "ab"
    ]
    assert (tmp_path / "moved/results/a/run.json").is_file()


@pytest.mark.slow
def test_a_site_without_water_is_named(make_dive, tmp_path, monkeypatch) -> None:
    make_dive(1)

    def unknown(*_: object) -> bool:
        raise ColorError("no frame with a known range")

    monkeypatch.setattr(module, "fit_site", unknown)
    (found,) = campaign(write(tmp_path / "campaign.yaml", f"{{name: a, site: s, {SIDES}}}")).dives
    assert found.state == "problems"
    assert found.error.startswith("site s has no water")


def test_a_defect_in_one_dive_costs_no_other(make_dive, tmp_path, monkeypatch) -> None:
    make_dive(1)

    def broken(*_: object, **__: object) -> None:
        raise ZeroDivisionError("x")

    monkeypatch.setattr(module, "run", broken)
    file = write(tmp_path / "campaign.yaml", f"{{name: a, {SIDES}}}", f"{{name: b, {SIDES}}}")
    assert [found.error for found in campaign(file).dives] == [
        "ZeroDivisionError: x (a bug in this program: see the log)"
    ] * 2


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("dives: [", "is not YAML"),
        (r'out: "D:\dives"', "is not YAML: .*: write paths of Windows with /, or without quotes"),
        ("{out: x, dives: {a: {left: l}}}", "dives: is not a list: begin each dive with a -"),
        ("out: a\nout: b", "'out' is given twice"),
        ("out: x", "dives: Field required"),
        ("# no line", "the file: holds no lines of the form key: value"),
        ("{out: x, dives: [monday]}", "dives.0: holds no lines"),
        (f"{{out: x, dives: [{{name: ../a, {SIDES}}}]}}", "dives.0.name"),
        (f"{{out: x, dives: [{{name: a, speed: 3, {SIDES}}}]}}", "dives.0.speed"),
        (f"{{out: x, dives: [{{name: 2024-05-01, {SIDES}}}]}}", "dives.0.name: .*in quotes"),
        (f"{{out: x, dives: [{{name: a, water: w.json, site: s, {SIDES}}}]}}", "give only one"),
        (
            f"{{out: x, dives: [{{name: a, {SIDES}}}, {{name: a, {SIDES}}}]}}",
            "two dives have the name 'a'",
        ),
        (f"{{out: x, dives: [{{name: A, {SIDES}}}, {{name: a, {SIDES}}}]}}", "the name 'A', upper"),
        (f"{{out: x, dives: [{{name: one dive, {SIDES}}}]}}", "has only letters"),
        ("{out: x, dives: []}", "dives: lists no dive"),
    ],
)
def test_what_is_wrong_with_a_campaigns_file_is_said(tmp_path, text: str, message: str) -> None:
    (tmp_path / "campaign.yaml").write_text(text)
    with pytest.raises(InputError, match=message):
        CampaignFile.read(tmp_path / "campaign.yaml")


@pytest.mark.slow
def test_a_plan_grows_with_the_pairs_and_shrinks_with_the_workers(make_dive) -> None:
    dive = make_dive(12)
    found = plan(dive.root / "L", dive.root / "R", dive.root / "cam.yaml", workers=(1, 2))
    assert (found.pairs, found.measured) == (12, 10)
    assert 3600 * found.core_hours == pytest.approx(12 * found.core_seconds_per_pair + found.fit_s)
    assert found.wall_hours[1] - found.wall_hours[2] == pytest.approx(
        12 * found.core_seconds_per_pair / 2 / 3600
    )
    assert sum(found.stage_seconds.values()) == pytest.approx(found.core_seconds_per_pair)
    assert found.stage_seconds["light"] > 0
    assert found.disk_bytes > 12 * dive.range_m.size * 4
    assert found.memory_bytes > 1e8


@pytest.mark.slow
def test_a_run_says_what_it_took_against_its_plan(make_dive, tmp_path) -> None:
    dive, out = make_dive(3), tmp_path / "out"
    sides = (dive.root / "L", dive.root / "R", dive.root / "cam.yaml")
    foretold = plan(*sides, out=out)
    summary = run(*sides, out)
    assert summary.plan
    planned, measured = summary.plan.planned, summary.plan.measured
    assert planned.core_hours == pytest.approx(foretold.core_hours)
    assert planned.wall_hours <= planned.core_hours
    assert 0.2 < measured.disk_bytes / planned.disk_bytes < 5
    assert measured.core_hours > 0
    assert measured.memory_bytes > 1e8
    assert "against its plan" in run_text(summary, out)
    assert summary.totals()["plan"]["measured"]["disk_bytes"] == measured.disk_bytes
    assert run(*sides, out).plan is None, "nothing was done"
    assert run(*sides, tmp_path / "other").plan is None


def test_a_dive_of_which_no_pair_goes_through_has_no_plan(make_dive) -> None:
    dive = make_dive(1)
    (dive.root / "R/0000.png").write_bytes(b"")
    with pytest.raises(InputError, match=r"is empty"):
        plan(dive.root / "L", dive.root / "R", dive.root / "cam.yaml")
