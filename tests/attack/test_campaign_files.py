"""A campaign replaces nothing but its own files, and its dives have names of their own."""

from pathlib import Path

import pytest

from stereo_seecolor.errors import InputError, OutputError
from stereo_seecolor.extras.fleet.campaign import campaign

DIVE = "{name: %s, left: dive/L, right: dive/R, calib: dive/cam.yaml%s}"
PLACES = (
    "campaign.csv",
    "campaign.json",
    "records/one.json",
    "records/one.ifdo.yaml",
    "records/collection.json",
    "waters/one.json",
)


def campaign_file(
    folder: Path,
    name: str = "one",
    out: str = ".",
    file: str = "reef.yaml",
    more: str = ", site: reef",
) -> Path:
    (folder / file).write_text(f"out: {out}\ndives: [{DIVE % (name, more)}]\n")
    return folder / file


@pytest.mark.parametrize("place", PLACES)
def test_files_of_others_are_not_replaced(make_dive, tmp_path: Path, place: str) -> None:
    make_dive(1)
    mine = tmp_path / place
    mine.parent.mkdir(exist_ok=True)
    mine.write_text("{}")
    with pytest.raises(OutputError, match=f"{place}: was not written by this campaign"):
        campaign(campaign_file(tmp_path))
    assert mine.read_text() == "{}"
    assert not (tmp_path / "one").exists()


def test_a_campaigns_own_file_is_not_replaced(make_dive, tmp_path: Path) -> None:
    make_dive(1)
    file = campaign_file(tmp_path, file="campaign.json")
    before = file.read_bytes()
    with pytest.raises(OutputError, match=r"campaign\.json: was not written by this campaign"):
        campaign(file)
    assert file.read_bytes() == before


@pytest.mark.slow
def test_a_campaign_replaces_what_it_wrote_until_somebody_changes_it(
    make_dive, tmp_path: Path
) -> None:
    make_dive(2)
    file = campaign_file(tmp_path)
    assert [campaign(file).dives[0].state for _ in range(2)] == ["done", "done"]
    table = tmp_path / "campaign.csv"
    table.write_text(table.read_text().replace("done", "fine"))
    with pytest.raises(
        OutputError,
        match=r"campaign\.csv: was not written by this campaign, or was changed afterwards",
    ):
        campaign(file)
    assert "fine" in table.read_text()


@pytest.mark.parametrize(
    "name", ["collection", "records", "waters", "campaign.csv", "campaign.json", "Records"]
)
def test_a_dive_is_not_called_as_a_file_of_the_campaign(
    make_dive, tmp_path: Path, name: str
) -> None:
    make_dive(1)
    with pytest.raises(
        InputError, match=f"a dive has the name '{name}' of a file or folder of the campaign"
    ):
        campaign(campaign_file(tmp_path, name))
