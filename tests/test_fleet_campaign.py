"""Many dives, one of them bad; and what a dive will cost."""

import csv
from pathlib import Path

import pytest

from stereo_seecolor.commands.campaign import CampaignFile, campaign
from stereo_seecolor.commands.plan import plan
from stereo_seecolor.errors import InputError


def write(file: Path, *dives: str, more: str = "") -> Path:
    file.write_text(f"out: results\n{more}dives:\n" + "".join(f"  - {dive}\n" for dive in dives))
    return file


SIDES = "left: dive/L, right: dive/R, calib: dive/cam.yaml"


def test_a_bad_dive_costs_no_other_and_only_it_is_run_again(make_dive, tmp_path) -> None:
    dive = make_dive(2)
    (dive.root / "R/0001.png").rename(dive.root / "later.png")
    (dive.root / "R/0001.png").write_bytes(b"")
    entries = (f"{{name: gone, {SIDES.replace('dive/L', 'nowhere')}}}", f"{{name: part, {SIDES}}}")
    file = write(tmp_path / "campaign.yaml", *entries, more="settings: {color.lock: survey, output.clouds: false}\n")
    result = campaign(file)
    assert [(found.state, found.ok, found.failed) for found in result.dives] == [("failed", 0, 0), ("some pairs failed", 1, 1)]
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


def test_a_defect_in_one_dive_costs_no_other(make_dive, tmp_path, monkeypatch) -> None:
    from stereo_seecolor.commands import campaign as module

    make_dive(1)

    def broken(*_: object, **__: object) -> None:
        raise ZeroDivisionError("x")

    monkeypatch.setattr(module, "run", broken)
    file = write(tmp_path / "campaign.yaml", f"{{name: a, {SIDES}}}", f"{{name: b, {SIDES}}}")
    assert [found.error for found in campaign(file).dives] == [
        "ZeroDivisionError: x (a defect of this program: the log holds more)"
    ] * 2


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("dives: [", "is no YAML"),
        ("out: x", "dives: Field required"),
        (f"{{out: x, dives: [{{name: ../a, {SIDES}}}]}}", "dives.0.name"),
        (f"{{out: x, dives: [{{name: a, speed: 3, {SIDES}}}]}}", "dives.0.speed"),
        (f"{{out: x, dives: [{{name: a, {SIDES}}}, {{name: a, {SIDES}}}]}}", "two dives are called 'a'"),
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
    assert found.wall_hours[1] - found.wall_hours[2] == pytest.approx(12 * found.core_seconds_per_pair / 2 / 3600)
    assert sum(found.stage_seconds.values()) == pytest.approx(found.core_seconds_per_pair)
    assert found.disk_bytes > 12 * dive.range_m.size * 4
    assert found.memory_bytes > 1e8


def test_a_dive_of_which_no_pair_goes_through_has_no_plan(make_dive) -> None:
    dive = make_dive(1)
    (dive.root / "R/0000.png").write_bytes(b"")
    with pytest.raises(InputError, match=r"is empty"):
        plan(dive.root / "L", dive.root / "R", dive.root / "cam.yaml")
