"""The page of a run: what it says, what it is made of, and that making it again costs nothing and
loses nothing.
"""

import csv
import json
import re
import shutil
import subprocess
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from conftest import REEF, Cli, CopyRun, Dive, SampleRun, contents
from page_scripts import dive_of

from calibration.formats import native
from calibration.refinement import Movement, Refinement
from calibration.rig_errors import RigErrors
from stereo_seecolor.commands.report import report
from stereo_seecolor.commands.run import run
from stereo_seecolor.config.file import load_config
from stereo_seecolor.dive.run_options import RunOptions
from stereo_seecolor.errors import InputError, OutputError, SeeColorError
from stereo_seecolor.extras.evaluation.charts.chart_types import CLASSIC
from stereo_seecolor.extras.evaluation.charts.search import patch_colors
from stereo_seecolor.extras.evaluation.charts.targets import FoundChart, chart
from stereo_seecolor.records import FrameRow
from stereo_seecolor.report.calibration_std import calibration_std
from stereo_seecolor.report.facts import RowFacts
from stereo_seecolor.report.frame_files import FrameFiles
from stereo_seecolor.report.live_page import LivePace
from stereo_seecolor.report.range_code import (
    RANGE_CODE,
    range_codes,
    std_blocks,
    std_codes,
    std_from_codes,
)
from stereo_seecolor.report.texts import digits
from stereo_seecolor.report.verdict import judge_so_far
from stereo_seecolor.run_folder.finished_run import open_run

STATIC = Path(__file__).resolve().parents[2] / "stereo_seecolor/report/static"

NASTY = "<img src=x onerror=alert(1)>"


def go(dive: Dive, out: Path, *settings: str, overwrite: bool = False) -> None:
    """A run without a page."""
    options = RunOptions(overwrite=overwrite, page="none")
    run(
        dive.root / "L",
        dive.root / "R",
        dive.root / "cam.yaml",
        out,
        load_config(None, settings),
        options,
    )


@pytest.fixture
def out(copy_run: CopyRun, tmp_path: Path) -> Path:
    return copy_run(tmp_path / "out", 2, page="none")


def colors(path: Path) -> np.ndarray:
    """The mean color of an image, which JPEG leaves as it is."""
    return cv2.imread(str(path)).astype(float).mean(axis=(0, 1))


# What it shows


@pytest.mark.slow
def test_every_frame_has_its_pictures_and_its_ranges(out: Path) -> None:
    assert report(out).made == 2
    assert dive_of(out)["shown"] == {
        name: ["thumbnails", "before", "ranges"] for name in ("0000", "0001")
    }
    for product in ("thumbnails", "before"):
        assert cv2.imread(str(out / "page" / product / "0001.jpg")).shape == (128, 176, 3)
    before, corrected = (
        colors(out / path) for path in ("page/before/0001.jpg", "corrected/0001.png")
    )
    assert abs(before - corrected).max() > 1
    assert 'src="corrected/0001.png"' in (out / "index.html").read_text("utf-8")


@pytest.mark.slow
def test_the_calibrations_part_of_standard_errors_is_said_to_be_assumed(out: Path) -> None:
    report(out)
    assert dive_of(out)["calibration"].startswith(
        "Standard errors include a calibration error of 0.5 % of a length"
    )
    assert "0.5 % is an assumption" in dive_of(out)["calibration"]
    assert "yaw" not in dive_of(out)["calibration"]
    assert dive_of(out)["calibration_std"] == 0.005


@pytest.mark.slow
def test_the_calibrations_own_standard_errors_are_taken_and_named(out: Path) -> None:
    rig = native.read(out / "rig.yaml")
    (out / "rig.yaml").write_bytes(
        native.to_bytes(replace(rig, errors=RigErrors(0.003, 0.004, "Kalibr")))
    )
    report(out)
    assert dive_of(out)["calibration_std"] == pytest.approx(0.005)
    assert "according to the calibration (Kalibr)" in dive_of(out)["calibration"]


@pytest.mark.slow
def test_what_the_check_measured_of_ranges_is_in_the_error_of_lengths(out: Path) -> None:
    described = json.loads((out / "run.json").read_text())
    described["totals"]["range_error"] = {"error": -0.01, "std": 0.04, "at_m": 1.8}
    (out / "run.json").write_text(json.dumps(described))
    report(out)
    measured = np.hypot(-0.01, 0.04)
    assert dive_of(out)["calibration_std"] == pytest.approx(np.hypot(0.005, measured))
    assert "ranges at 1.8 m may be wrong by -1.0 ± 4 %" in dive_of(out)["calibration"]
    stated = replace(native.read(out / "rig.yaml"), errors=RigErrors(0.003, 0.004, "Kalibr"))
    (out / "rig.yaml").write_bytes(native.to_bytes(stated))
    assert calibration_std(open_run(out)).total == pytest.approx(0.005)  # not contradicted
    described["totals"]["range_error"]["error"] = 0.1
    (out / "run.json").write_text(json.dumps(described))
    measured = np.hypot(0.1, 0.04)
    assert calibration_std(open_run(out)).total == pytest.approx(np.hypot(0.005, measured))


@pytest.mark.slow
def test_inputs_are_found_from_another_folder(
    make_dive: Callable[..., Dive], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    dive = make_dive(2)
    monkeypatch.chdir(dive.root)
    options = RunOptions(page="none")
    run(Path("L"), Path("R"), Path("cam.yaml"), tmp_path / "out", load_config(None, ()), options)
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    report(tmp_path / "out")
    assert "before" in dive_of(tmp_path / "out")["shown"]["0000"]


@pytest.mark.slow
def test_a_refined_rig_says_what_its_yaw_makes_of_ranges(out: Path) -> None:
    rig = native.read(out / "rig.yaml")
    refinement = Refinement((Movement("yaw", 0.01, 0.001),), 1.0, 0.1, 12, 1000, 150.0)
    (out / "rig.yaml").write_bytes(native.to_bytes(replace(rig, refinement=refinement)))
    report(out)
    said = re.search(r"yaw adds ([0-9.]+) % at a range of ([0-9.]+) m", dive_of(out)["calibration"])
    assert said
    assert float(said[1]) == pytest.approx(100 * 0.001 * float(said[2]) / 0.1, rel=0.05)
    assert dive_of(out)["calibration_std"] == pytest.approx(
        np.hypot(0.005, float(said[1]) / 100), rel=0.05
    )


@pytest.mark.slow
def test_every_plot_has_a_title(out: Path) -> None:
    report(out)
    found = dive_of(out)
    written = {
        "light_gain",
        "exposure",
        "camera_exposure_s",
        "camera_gain",
        "camera_aperture",
        "clipped_fraction",
    }
    assert not {f"plots.{plot}" for plot in found["plots"].keys() | written} - found["texts"].keys()


@pytest.mark.slow
def test_a_dive_without_faults_is_called_good(
    make_dive: Callable[..., Dive], tmp_path: Path
) -> None:
    dive, known = make_dive(2), load_config(None, ["color.robust.white_point=[1, 1, 1]"])
    run(dive.root / "L", dive.root / "R", dive.root / "cam.yaml", tmp_path / "out", known)
    page = (tmp_path / "out/index.html").read_text("utf-8")
    assert "Good: no problem was detected." in page
    assert "2 of 2" in page
    assert "baseline 100 mm" in page


def test_something_small_that_moves_is_no_reason_to_doubt_a_dive() -> None:
    def rows(percent: float) -> RowFacts:
        said = f"{percent}% of the left image has no match: a moving object"
        return RowFacts(tuple(FrameRow(f"f{i}", warnings=(said,)) for i in range(4)))

    assert judge_so_far(rows(1.2)).good
    assert not judge_so_far(rows(12.0)).good


@pytest.mark.slow
def test_what_failed_is_counted_and_named(make_dive: Callable[..., Dive], tmp_path: Path) -> None:
    dive = make_dive(3)
    (dive.root / "L/0001.png").write_bytes(b"")
    go(dive, tmp_path / "out")
    report(tmp_path / "out")
    page = (tmp_path / "out/index.html").read_text("utf-8")
    assert "Check this before you use the results:" in page
    assert "1 of 3 pairs failed." in page
    assert re.search(
        r'<td class="what">is empty.*?</td>\s*<td class="number">1</td>.*?#frames/0001', page, re.S
    )
    assert dive_of(tmp_path / "out")["status"] == ["ok", "failed", "ok"]


@pytest.mark.slow
def test_a_run_without_a_good_frame_has_a_page(
    make_dive: Callable[..., Dive], tmp_path: Path
) -> None:
    dive = make_dive(2)
    noise = np.random.default_rng(0)
    for file in sorted((dive.root / "L").iterdir()):  # nothing that the right camera saw
        cv2.imwrite(str(file), noise.integers(0, 256, cv2.imread(str(file)).shape, np.uint8))
    go(dive, tmp_path / "out")
    assert report(tmp_path / "out").made == 0
    assert "No frame finished all stages." in (tmp_path / "out/index.html").read_text("utf-8")


@pytest.mark.slow
def test_names_with_markup_stay_text(make_dive: Callable[..., Dive], tmp_path: Path) -> None:
    dive = make_dive(2)
    for side in "LR":
        (dive.root / side / "0001.png").rename(dive.root / side / f"{NASTY}.png")
    go(dive, tmp_path / "out")
    report(tmp_path / "out")
    page = (tmp_path / "out/index.html").read_text("utf-8")
    assert NASTY not in page
    assert "&lt;img src=x onerror=alert(1)&gt;" in page
    assert "corrected/%3Cimg%20src%3Dx%20onerror%3Dalert%281%29%3E.png" in page
    assert NASTY in dive_of(tmp_path / "out")["names"]


@pytest.mark.slow
def test_the_page_allows_no_network_and_no_inline_script(out: Path) -> None:
    report(out)
    page = (out / "index.html").read_text("utf-8")
    policy = re.search(r'Content-Security-Policy" content="([^"]*)"', page)
    assert policy
    assert "default-src 'none'" in policy[1]
    assert "http" not in policy[1]
    assert not re.search(r'(src|href)="(https?:)?//', page)
    assert not re.search(r"<script(?! src=\"page/)", page)


@pytest.mark.slow
def test_formats_that_no_browser_shows_are_shown_as_jpeg(
    make_dive: Callable[..., Dive], tmp_path: Path
) -> None:
    dive = make_dive(1, dtype=np.uint16)
    go(dive, tmp_path / "a", "output.image_format=tiff32")
    go(dive, tmp_path / "b")
    report(tmp_path / "a")
    report(tmp_path / "b")
    assert (
        abs(
            colors(tmp_path / "a/page/after/0000.jpg") - colors(tmp_path / "b/corrected/0000.png")
        ).max()
        < 2
    )


# Making it again


@pytest.mark.slow
def test_the_page_takes_at_most_15_percent_of_a_lean_folder_and_images_of_the_map_5(
    sample_run: SampleRun, tmp_path: Path
) -> None:
    """Of the folder as it would be: its frames, and the page and the map of the sample run."""
    sides, lean = (REEF / "left", REEF / "right", REEF / "cam.yaml"), tmp_path / "lean"
    shutil.copytree(sample_run.out, lean, ignore=shutil.ignore_patterns("clouds", "map", "page"))
    config = load_config(None, ["output.preset=lean"])
    assert run(*sides, lean, config, RunOptions(page="none")).all_done
    page = sample_run.out / "page"
    assert (page / "map/map.js").is_file()

    def size(folder: Path, pattern: str = "*") -> int:
        return sum(path.stat().st_size for path in folder.rglob(pattern) if path.is_file())

    whole, textures = sum(map(size, (lean, page, sample_run.out / "map"))), size(page, "textured_*")
    assert size(page) - textures <= 0.15 * whole
    assert textures <= 0.05 * whole


@pytest.mark.slow
def test_a_page_is_made_once(out: Path) -> None:
    report(out)
    before = {path: path.stat().st_mtime_ns for path in (out / "page").rglob("*") if path.is_file()}
    result = report(out)
    assert (result.made, result.kept) == (0, 2)
    assert before == {
        path: path.stat().st_mtime_ns for path in (out / "page").rglob("*") if path.is_file()
    }


@pytest.mark.slow
def test_what_a_run_makes_of_its_frames_in_memory_is_what_their_files_give(
    make_dive: Callable[..., Dive], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    dive, out = make_dive(2), tmp_path / "out"
    with monkeypatch.context() as patched:
        patched.setattr(FrameFiles, "make", None)  # reads files
        run(dive.root / "L", dive.root / "R", dive.root / "cam.yaml", out)
    made = {path.relative_to(out): path.read_bytes() for path in (out / "page").glob("*/*")}
    assert len(made) == 7
    shutil.rmtree(out / "page")
    report(out)
    assert {path.relative_to(out): path.read_bytes() for path in (out / "page").glob("*/*")} == made


@pytest.mark.slow
def test_a_frame_that_changed_is_made_again(make_dive: Callable[..., Dive], tmp_path: Path) -> None:
    dive, out = make_dive(3), tmp_path / "out"
    go(dive, out)
    report(out)
    before = contents(out)
    cv2.imwrite(str(dive.root / "L/0001.png"), cv2.imread(str(dive.root / "L/0001.png"))[..., ::-1])
    go(dive, out)
    assert not (out / "index.html").exists()  # it would show what is no longer there
    changed = [
        name
        for name in ("0000", "0001", "0002")
        if contents(out)[f"corrected/{name}.png"] != before[f"corrected/{name}.png"]
    ]
    result = report(out)
    assert "0001" in changed
    assert (result.made, result.kept) == (len(changed), 3 - len(changed))


@pytest.mark.slow
def test_pictures_of_inputs_that_are_gone_are_kept(
    make_dive: Callable[..., Dive], tmp_path: Path
) -> None:
    dive, out = make_dive(2), tmp_path / "out"
    go(dive, out)
    report(out)
    shutil.rmtree(dive.root)
    assert report(out).made == 0
    assert (out / "page/before/0001.jpg").exists()


@pytest.mark.slow
def test_without_inputs_the_page_shows_what_there_is(
    make_dive: Callable[..., Dive], tmp_path: Path
) -> None:
    dive, out = make_dive(2), tmp_path / "out"
    go(dive, out)
    shutil.rmtree(dive.root)
    assert report(out).made == 2
    assert dive_of(out)["shown"]["0001"] == ["thumbnails", "ranges"]


@pytest.mark.slow
def test_a_damaged_frame_is_named_and_left_out(out: Path) -> None:
    (out / "range/0001.tiff").write_bytes(b"broken")
    result = report(out)
    assert result.left_out.keys() == {"0001"}
    assert "run again" in result.left_out["0001"]
    assert list(dive_of(out)["shown"]) == ["0000"]


# Nothing of a user's is lost


@pytest.mark.slow
def test_overwrite_takes_the_page_away(
    copy_run: CopyRun, make_dive: Callable[..., Dive], tmp_path: Path
) -> None:
    dive, out = make_dive(2), tmp_path / "out"
    copy_run(out, 2, page="none")
    report(out)
    (dive.root / "L/0001.png").unlink()
    go(dive, out, overwrite=True)
    assert not (out / "index.html").exists()
    assert not (out / "page").exists()


@pytest.mark.slow
def test_a_pair_that_is_gone_takes_its_pictures_along(
    copy_run: CopyRun, make_dive: Callable[..., Dive], tmp_path: Path
) -> None:
    dive, out = make_dive(3), tmp_path / "out"
    copy_run(out, 3, page="none")
    report(out)
    for side in "LR":
        (dive.root / side / "0002.png").unlink()
    go(dive, out)
    assert not list((out / "page").rglob("0002*"))
    report(out)
    assert dive_of(out)["names"] == ["0000", "0001"]


@pytest.mark.slow
def test_an_edited_page_is_kept_aside(out: Path) -> None:
    report(out)
    (out / "index.html").write_text("my own notes")
    (out / "page/before/0001.jpg").write_bytes(b"my own picture")
    report(out)
    assert (out / "set_aside/index.html").read_text() == "my own notes"
    assert (out / "set_aside/page/before/0001.jpg").read_bytes() == b"my own picture"
    assert "stereo-seecolor" in (out / "index.html").read_text("utf-8")


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", ["index.html", "page/notes.txt", "page/before/notes.txt", "page/mine/x.js"]
)
def test_files_of_others_where_the_page_goes_are_refused(out: Path, name: str) -> None:
    (out / name).parent.mkdir(parents=True, exist_ok=True)
    (out / name).write_text("field notes")
    with pytest.raises(OutputError):
        report(out)
    assert (out / name).read_text() == "field notes"
    assert not (out / "page/dive.js").exists()


@pytest.mark.slow
@pytest.mark.parametrize("name", ["page", "page/before"])
def test_a_link_out_of_the_folder_is_not_followed(out: Path, tmp_path: Path, name: str) -> None:
    (tmp_path / "elsewhere").mkdir()
    (out / name).parent.mkdir(exist_ok=True)
    (out / name).symlink_to(tmp_path / "elsewhere")
    with pytest.raises(OutputError, match="is a link"):
        report(out)
    assert not list((tmp_path / "elsewhere").iterdir())


def test_a_folder_without_a_run_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="holds no finished run"):
        report(tmp_path)
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
def test_a_chart_is_shown_before_and_after_beside_its_published_colors(
    out: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    corners = np.array([(30, 30), (120, 30), (120, 90), (30, 90)], float)
    monkeypatch.setattr(
        "stereo_seecolor.extras.evaluation.charts.search.find_charts",
        lambda image: (FoundChart(CLASSIC, corners, 0.9, np.ones(24, bool)),),
    )
    report(out, charts=True)
    kept = json.loads((out / "page/charts.json").read_bytes())["charts"]
    assert [each["frame"] for each in kept] == ["0000", "0001"]
    assert kept[0]["published"][0] == "rgb(115 82 68)"  # dark skin
    assert kept[0]["after_ciede2000"] > 5  # there is none in truth
    report(out)
    page = (out / "index.html").read_text("utf-8")
    assert page.count('class="patches"') == 2
    assert f"<strong>{kept[1]['after_ciede2000']:.1f}</strong>" in page


def test_patches_of_the_published_colors_have_no_difference() -> None:
    cells = np.rint(CLASSIC.srgb * 255).astype(np.uint8).reshape(4, 6, 3)
    image = np.kron(cells, np.ones((20, 20, 1), np.uint8))
    colors, difference = patch_colors(
        chart("chart", np.array([(0, 0), (120, 0), (120, 80), (0, 80)]), image.shape[:2]), image
    )
    assert difference < 0.5
    assert colors[0] == "rgb(115 82 68)"


# Written by the run itself


@pytest.mark.slow
def test_a_run_from_python_writes_the_page(make_dive: Callable[..., Dive], tmp_path: Path) -> None:
    dive = make_dive(2)
    run(dive.root / "L", dive.root / "R", dive.root / "cam.yaml", tmp_path / "out")
    assert "White point: all colors may share a tint of about" in (
        tmp_path / "out/index.html"
    ).read_text("utf-8")
    assert set(dive_of(tmp_path / "out")["shown"]) == {"0000", "0001"}


class Watch:
    """Reads the page after each pair of a run."""

    def __init__(self, page: Path) -> None:
        self.page = page
        self.seen: list[str] = []

    def begin(self, stage: str, total: int) -> None:
        """Nothing is there yet."""

    def advance(self, row: FrameRow) -> None:
        self.seen.append(self.page.read_text("utf-8"))


@pytest.mark.slow
def test_while_a_run_works_its_page_says_how_far_it_is(
    make_dive: Callable[..., Dive], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        "stereo_seecolor.report.live_page.PACE", LivePace(every_s=0.0, most_of_time=1e9)
    )
    dive, watch = make_dive(3), Watch(tmp_path / "out/index.html")
    (dive.root / "L/0001.png").write_bytes(b"")
    for side in "LR":
        (dive.root / side / "0002.png").rename(dive.root / side / f"{NASTY}.png")
    options = RunOptions(workers=1, page="live", listener=watch)
    run(
        dive.root / "L",
        dive.root / "R",
        dive.root / "cam.yaml",
        tmp_path / "out",
        load_config(None, []),
        options,
    )
    ranges = next(page for page in watch.seen if "ranges, 2 of 3." in page)
    assert "1 of 2 pairs failed." in ranges
    colors = next(page for page in watch.seen if "colors, 1 of 2." in page)
    assert colors.count("data:image/jpeg;base64,") == 3
    assert all(NASTY not in page for page in watch.seen)
    final = (tmp_path / "out/index.html").read_text("utf-8")
    assert "is in progress" not in final
    assert "1 of 3 pairs failed." in final


@pytest.mark.slow
def test_no_page_says_that_a_run_works_that_has_ended_by_an_error(
    make_dive: Callable[..., Dive], tmp_path: Path
) -> None:
    dive, options = make_dive(2), RunOptions(page="live", strict=True)
    (dive.root / "L/0001.png").write_bytes(b"")
    with pytest.raises(SeeColorError):
        run(
            dive.root / "L",
            dive.root / "R",
            dive.root / "cam.yaml",
            tmp_path / "out",
            load_config(None, []),
            options,
        )
    assert not (tmp_path / "out/index.html").exists()


# The command line


@pytest.mark.slow
def test_run_writes_the_page(make_dive: Callable[..., Dive], tmp_path: Path, cli: Cli) -> None:
    code, text, _ = cli(*make_dive(2).command(tmp_path / "out"))
    assert code == 0
    assert f"{tmp_path / 'out/index.html'}: the page of the dive" in text
    assert (tmp_path / "out/index.html").exists()


@pytest.mark.slow
def test_report_says_which_frames_it_does_not_show(out: Path, cli: Cli) -> None:
    (out / "range/0001.tiff").write_bytes(b"broken")
    code, text, _ = cli("report", out)
    assert code == 3
    assert "not shown: 0001:" in text
    assert "1 frame shown, 0 of them kept" in text


@pytest.mark.slow
def test_report_as_json(out: Path, cli: Cli) -> None:
    _, text, _ = cli("report", out, "--json")
    assert json.loads(text)["made"] == 2


# Ranges as the page holds them


def test_coded_ranges_are_exact_to_a_tenth_of_a_millimeter_at_a_meter() -> None:
    rng = np.random.default_rng(1)
    range_m = rng.uniform(0.3, 20, (61, 83)).astype(np.float32)
    range_m[rng.random(range_m.shape) < 0.2] = np.nan
    unknown = np.full_like(range_m, np.nan)
    codes, step_per_m = range_codes(range_m, unknown)
    found = 1 / (np.where(codes > 0, codes, np.nan) * step_per_m)
    assert (np.isnan(found) == np.isnan(range_m)).all()
    assert np.nanmax(abs(found - range_m) / range_m**2) < 1e-4


@pytest.mark.parametrize("std_at_1_m", [1e-5, 0.002, 0.02])
def test_coded_ranges_are_off_by_a_third_of_their_standard_error_at_most(std_at_1_m: float) -> None:
    rng = np.random.default_rng(1)
    range_m = rng.uniform(0.5, 20, (61, 83)).astype(np.float32)
    codes, step_per_m = range_codes(range_m, np.float32(std_at_1_m) * range_m**2)
    off = abs(codes * step_per_m - 1 / range_m)
    assert off.max() < max(1e-4, 0.36 * std_at_1_m)


def test_ranges_nearer_than_the_step_allows_take_a_coarser_one() -> None:
    range_m = np.array([[0.02, 0.5, np.nan]], np.float32)
    codes, step_per_m = range_codes(range_m, np.full_like(range_m, np.nan))
    assert step_per_m > RANGE_CODE.step_per_m
    assert codes[0, 2] == 0 < codes[0, :2].max() < 65536
    np.testing.assert_allclose(1 / (codes[0, :2] * step_per_m), range_m[0, :2], rtol=1e-3)


def test_coded_standard_errors_are_exact_to_three_percent() -> None:
    std_m = np.random.default_rng(2).uniform(1e-4, 0.5, (30, 43)).astype(np.float32)
    std_m[:9, :9] = np.nan
    found, expected = std_from_codes(std_codes(std_m)), std_blocks(std_m)
    assert found.shape == (8, 11)
    assert np.isnan(found[0, 0])
    np.testing.assert_allclose(found, expected, rtol=0.03)


@pytest.mark.slow
def test_the_tables_rows_are_read_back_as_they_were(out: Path) -> None:
    from stereo_seecolor.run_folder.frames_csv import frames_csv, read_frames

    stages = list(open_run(out).totals["stage_seconds"])
    rows = read_frames(out / "frames.csv", stages)
    assert b"".join(frames_csv(rows)) == (out / "frames.csv").read_bytes()
    assert [
        row["name"] for row in csv.DictReader((out / "frames.csv").read_text().splitlines())
    ] == [row.name for row in rows]


def test_a_warning_with_a_semicolon_is_read_back_as_one(tmp_path: Path) -> None:
    from stereo_seecolor.run_folder.frames_csv import frames_csv, read_frames

    row = FrameRow("a", warnings=("a cast; settled by a chart", "dark"))
    (tmp_path / "frames.csv").write_bytes(b"".join(frames_csv([row])))
    (found,) = read_frames(tmp_path / "frames.csv", ())
    assert found.warnings == ("a cast, settled by a chart", "dark")


# The page's program


BUILT = ("page.js", "map.js", "live.js", "page.css", "licenses.txt")


@pytest.mark.slow
def test_the_built_program_is_that_of_its_sources(web: Path, tmp_path: Path) -> None:
    subprocess.run(["npx", "--no-install", "tsc", "--noEmit"], cwd=web, check=True)
    subprocess.run(["node", "build.mjs", str(tmp_path)], cwd=web, check=True)
    for name in BUILT:
        assert (tmp_path / name).read_bytes() == (STATIC / name).read_bytes(), (
            f"{name}: run npm run build in web/"
        )


@pytest.mark.slow
def test_the_unit_tests_of_the_program_pass(web: Path) -> None:
    run = subprocess.run(["npm", "test"], cwd=web, capture_output=True, text=True)
    assert run.returncode == 0, run.stdout
    assert int(re.search(r"^# pass (\d+)$", run.stdout, re.MULTILINE)[1]) >= 30  # type: ignore[index]


@pytest.mark.parametrize(
    ("value", "shown"),
    [
        (0.0, "0"),
        (5.67e-17, "0"),
        (0.00001364, "0.000014"),
        (0.0123456, "0.0123"),
        (12345.6, "12346"),
    ],
)
def test_numbers_of_the_page_have_no_powers_of_ten(value: float, shown: str) -> None:
    assert digits(value) == shown
