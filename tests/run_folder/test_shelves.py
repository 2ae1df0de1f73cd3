"""A large dive's files are spread over folders of so many frames, and all that reads a run finds
them there.
"""

from pathlib import Path

import pytest
from page_scripts import dive_of

from stereo_seecolor.commands.run import run
from stereo_seecolor.compute.shard import Shard
from stereo_seecolor.dive.run_options import RunOptions
from stereo_seecolor.extras.fleet.merge import merge
from stereo_seecolor.run_folder import layout
from stereo_seecolor.run_folder.finished_run import open_run
from stereo_seecolor.run_folder.layout import Shelves, in_subfolder, subfolder_of


def test_small_dives_have_one_folder_a_product_and_large_ones_a_folder_a_thousand_frames() -> None:
    assert subfolder_of((0, 10_000)) == ""
    assert [subfolder_of((number, 10_001)) for number in (0, 999, 1000, 10_000)] == [
        "00000",
        "00000",
        "00001",
        "00010",
    ]
    assert in_subfolder("original/range/a.tiff", "00001") == "original/range/00001/a.tiff"
    assert in_subfolder("range/a.tiff", "") == "range/a.tiff"


def contents(out: Path) -> dict[str, bytes]:
    """Every file of the frames."""
    files = [
        path for product in layout.PRODUCTS for path in (out / product).rglob("*") if path.is_file()
    ]
    return {path.relative_to(out).as_posix(): path.read_bytes() for path in files}


def flat(files: dict[str, bytes]) -> dict[str, bytes]:
    """The same files, each product's in one folder."""
    return {
        "/".join(part for part in name.split("/") if not part.isdigit()): content
        for name, content in files.items()
    }


@pytest.fixture
def large(monkeypatch: pytest.MonkeyPatch) -> None:
    """Five pairs are a large dive."""
    monkeypatch.setattr(layout, "SHELVES", Shelves(most_flat=4, each=2))


@pytest.mark.slow
@pytest.mark.usefixtures("large")
def test_a_large_dive_holds_the_bytes_of_a_small_one_on_shelves_resumed_and_merged(
    make_dive, tmp_path: Path
) -> None:
    dive = make_dive(5)
    sides = (dive.root / "L", dive.root / "R", dive.root / "cam.yaml")
    with pytest.MonkeyPatch.context() as usual:
        usual.setattr(layout, "SHELVES", Shelves())
        run(*sides, tmp_path / "flat")
    run(*sides, tmp_path / "large")
    large = contents(tmp_path / "large")
    assert {
        "corrected/00000/0001.png",
        "range/00001/0002.tiff",
        "clouds/00002/0004.ply",
    } <= large.keys()
    assert flat(large) == contents(tmp_path / "flat")
    frames = open_run(tmp_path / "large").frames
    assert [frame.name for frame in frames] == [f"{number:04d}" for number in range(5)]
    assert all(path.is_file() for frame in frames for path in frame.products.values())

    assert dive_of(tmp_path / "large")["shelves"][3] == "00001"
    assert (tmp_path / "large/page/before/00001/0003.jpg").is_file()
    assert 'src="page/before/00001/0003.jpg"' in (tmp_path / "large/index.html").read_text()

    lost = tmp_path / "large/range/00001/0002.tiff"
    lost.unlink()
    (lost.parent / ".writing-c3104a26564-9-0.png").write_bytes(b"half")
    assert run(*sides, tmp_path / "large").kept == 4
    assert contents(tmp_path / "large") == large
    parts = [tmp_path / "part1", tmp_path / "part2"]
    for number, part in enumerate(parts, 1):
        run(*sides, part, options=RunOptions(shard=Shard(number, 2)))
    merge(parts, tmp_path / "merged")
    assert contents(tmp_path / "merged") == large
    assert run(*sides, tmp_path / "merged").kept == 5
    files = [
        path
        for path in (tmp_path / "merged/.state").rglob("*")
        if path.suffix in (".json", ".kept")
    ]
    assert {path.parent.parent.name for path in files if path.stem.isdigit()} == {
        "spread",
        "tables",
    }


@pytest.mark.slow
def test_a_dive_that_has_become_large_keeps_what_is_done_where_it_is(
    make_dive, tmp_path: Path, monkeypatch
) -> None:
    dive = make_dive(5)
    sides, out = (dive.root / "L", dive.root / "R", dive.root / "cam.yaml"), tmp_path / "out"
    hidden = {
        side: (dive.root / side / "0004.png").rename(tmp_path / f"{side}.png") for side in "LR"
    }
    run(*sides, out)
    monkeypatch.setattr(layout, "SHELVES", Shelves(most_flat=4, each=2))
    for side, path in hidden.items():
        path.rename(dive.root / side / "0004.png")
    assert run(*sides, out).count("ok") == 5
    assert {str(path.relative_to(out)) for path in out.glob("range/**/*.tiff")} == {
        *(f"range/000{number}.tiff" for number in range(4)),
        "range/00002/0004.tiff",
    }
    run(*sides, out, options=RunOptions(overwrite=True))
    assert not list(out.glob("range/*.tiff"))
