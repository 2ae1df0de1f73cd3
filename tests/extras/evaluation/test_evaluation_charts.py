import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from stereo_seecolor.cli.text import table
from stereo_seecolor.config.file import load_config
from stereo_seecolor.errors import InputError, OutputError
from stereo_seecolor.extras.evaluation.baselines import OURS
from stereo_seecolor.extras.evaluation.charts.chart_spread import seen_chart, spread_over_charts
from stereo_seecolor.extras.evaluation.charts.chart_types import CLASSIC
from stereo_seecolor.extras.evaluation.charts.scores import (
    ChartReport,
    correct_by_all,
    evaluate_charts,
    score_target,
)
from stereo_seecolor.extras.evaluation.charts.targets import (
    chart,
    neutral,
    read_targets,
    targets_of,
)
from stereo_seecolor.extras.evaluation.other_results import OtherResults
from stereo_seecolor.files.srgb import decode_srgb, encode_srgb

FEW_STEPS = load_config(None, ["color.paper.iterations=20"])
"""The paper's method takes most of the time, and has tests of its own."""
CELL, GAP = 22, 4
SIZE = (240, 320)
CORNER = np.array([75.0, 60.0])


def draw_chart(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """An image (H, W, 3) in [0, 1] with a chart on gray rubble, and the chart's corners (4, 2)."""
    image = 0.55 + 0.1 * cv2.resize(rng.standard_normal((60, 80, 3)), SIZE[::-1])
    width, height = 6 * CELL + 7 * GAP, 4 * CELL + 5 * GAP
    x0, y0 = CORNER.astype(int)
    image[y0 : y0 + height, x0 : x0 + width] = 0.06
    for patch in range(24):
        row, column = divmod(patch, 6)
        y, x = y0 + GAP + row * (CELL + GAP), x0 + GAP + column * (CELL + GAP)
        image[y : y + CELL, x : x + CELL] = CLASSIC.srgb[patch]
    corners = CORNER + np.array([[0, 0], [width, 0], [width, height], [0, height]])
    return np.clip(image + 0.005 * rng.standard_normal(image.shape), 0, 1), corners


@pytest.fixture
def chart_image() -> tuple[np.ndarray, np.ndarray]:
    return draw_chart(np.random.default_rng(5))


def eight_bit(fractions: np.ndarray) -> np.ndarray:
    return np.round(np.clip(fractions, 0, 1) * 255).astype(np.uint8)


def flat_range() -> np.ndarray:
    return np.full(SIZE, 2.0, np.float32)


def test_true_colors_score_zero(chart_image: tuple[np.ndarray, np.ndarray]) -> None:
    image, corners = chart_image
    row = score_target("f", chart("c", corners, SIZE), "truth", image, flat_range())
    assert row.psi_deg < 0.6  # noise
    assert row.ciede2000 < 0.5
    assert row.clipped_fraction == 0
    assert row.range_m == 2.0
    darker = encode_srgb(0.5 * decode_srgb(image))
    assert (
        score_target("f", chart("c", corners, SIZE), "darker", darker, flat_range()).ciede2000 < 0.6
    )


def test_a_cast_is_seen(chart_image: tuple[np.ndarray, np.ndarray]) -> None:
    image, corners = chart_image
    row = score_target(
        "f", chart("c", corners, SIZE), "blue", image * [0.4, 0.9, 1.0], flat_range()
    )
    assert row.psi_deg > 15
    assert row.ciede2000 > 8


def test_a_picture_without_colors_is_seen_by_its_chroma(
    chart_image: tuple[np.ndarray, np.ndarray],
) -> None:
    image, corners = chart_image
    gray = np.repeat(image.mean(axis=-1, keepdims=True), 3, axis=-1)
    true, row = (
        score_target("f", chart("c", corners, SIZE), "gray", one, flat_range())
        for one in (image, gray)
    )
    assert (row.psi_deg, row.chroma) == pytest.approx((0, 0), abs=0.01)
    assert true.chroma > 3


@pytest.mark.slow
def test_the_chart_is_found_through_blue_water(chart_image: tuple[np.ndarray, np.ndarray]) -> None:
    image, _ = chart_image
    (found,) = targets_of([], eight_bit(image * [0.35, 0.8, 0.9]), flat_range())
    assert (found.name, found.type) == ("chart", CLASSIC)
    for number, patch in enumerate(found.patches):
        row, column = divmod(number, 6)
        y, x = (CORNER[::-1] + GAP + np.array([row, column]) * (CELL + GAP)).astype(int)
        inside = patch[y : y + CELL, x : x + CELL].sum()
        assert inside > 0.9 * patch.sum() > 100, "within the patch that was drawn"


def test_neutral_pixels_are_bright_unclipped_and_ranged() -> None:
    image = np.full((40, 60, 3), 30, np.uint8)
    image[10:30, 10:30] = [60, 180, 200]
    image[10:15, 10:30] = 255
    range_m = np.full((40, 60), 3.0, np.float32)
    range_m[25:30, 10:30] = np.nan
    polygon = np.array([[5.0, 5.0], [40.0, 5.0], [40.0, 35.0], [5.0, 35.0]])
    white = neutral("w", polygon, image, range_m).mask
    expected = np.zeros_like(white)
    expected[15:25, 10:30] = True
    np.testing.assert_array_equal(white, expected)
    sixteen = neutral("w", polygon, image.astype(np.uint16) * 257, range_m).mask
    np.testing.assert_array_equal(sixteen, expected)


@pytest.fixture
def folders(tmp_path: Path, chart_image: tuple[np.ndarray, np.ndarray]) -> tuple[Path, Path]:
    """Two images through a known water, only the first with a chart."""
    rng = np.random.default_rng(2)
    z = np.linspace(1.5, 3.5, SIZE[0])[:, None] * np.ones(SIZE)
    for name, image in (("a", chart_image[0]), ("b", 0.4 + 0.05 * rng.standard_normal((*SIZE, 3)))):
        light = (
            decode_srgb(np.clip(image, 0, 1))
            * [0.5, 0.9, 1.0]
            * np.exp(-z[..., None] * [0.35, 0.1, 0.08])
        )
        light += np.array([0.02, 0.08, 0.1]) * -np.expm1(-z[..., None] * [0.35, 0.1, 0.08])
        for folder, content in (
            ("image", eight_bit(encode_srgb(light))[..., ::-1]),
            ("range", z.astype(np.float32)),
        ):
            (tmp_path / folder).mkdir(exist_ok=True)
            assert cv2.imwrite(str(tmp_path / folder / f"{name}.tiff"), content)
    return tmp_path / "image", tmp_path / "range"


@pytest.mark.slow
def test_every_method_gets_a_row_and_ours_is_nearer_than_raw(
    folders: tuple[Path, Path], tmp_path: Path
) -> None:
    (tmp_path / "their tool").mkdir()
    (tmp_path / "their tool" / "a.tiff").write_bytes((folders[0] / "a.tiff").read_bytes())
    report = evaluate_charts(
        *folders, sheet=tmp_path / "sheet.png", others=[tmp_path / "their tool"]
    )
    means = {row.method: row for row in report.means()}
    assert means["their tool"].psi_deg == pytest.approx(means["raw"].psi_deg)
    methods = {
        "their tool",
        "raw",
        "contrast stretch",
        "gray world",
        "simple model",
        "sea-thru",
        "paper",
        OURS,
    }
    assert set(means) == methods
    assert report.without_target == ("b",)
    assert len(report.rows) == len(methods)
    assert means[OURS].psi_deg < 0.5 * means["raw"].psi_deg
    assert means[OURS].clipped_fraction < 0.02
    sheet = cv2.imread(str(tmp_path / "sheet.png"))
    assert sheet.shape[1] == 8 * 320


@pytest.mark.slow
def test_a_sheet_that_exists_stays_and_its_option_is_named(tmp_path: Path) -> None:
    (tmp_path / "charts.png").touch()
    with pytest.raises(OutputError, match="give another name by --sheet; nothing was changed"):
        evaluate_charts(tmp_path, tmp_path, sheet=tmp_path / "charts.png")


@pytest.mark.slow
def test_a_method_has_one_column_of_the_sheet(folders: tuple[Path, Path], tmp_path: Path) -> None:
    for tool, names in (("dark", "b"), ("copy", "ab")):
        (tmp_path / tool).mkdir()
        for name in names:
            image = cv2.imread(str(folders[0] / f"{name}.tiff"))
            cv2.imwrite(
                str(tmp_path / tool / f"{name}.tiff"), image // (9 if tool == "dark" else 1)
            )
    polygon = {"polygon": [[5, 5], [25, 5], [25, 25], [5, 25]]}
    (tmp_path / "targets.json").write_text(json.dumps({"a": [polygon], "b": [polygon]}))
    others = [tmp_path / "dark", tmp_path / "copy"]
    report = evaluate_charts(
        *folders, tmp_path / "targets.json", FEW_STEPS, sheet=tmp_path / "sheet.png", others=others
    )
    assert report.missing == {"dark": ("a",)}
    for frame in np.vsplit(cv2.imread(str(tmp_path / "sheet.png")), 2):
        raw, *_, copy, dark = (column[30:] for column in np.hsplit(frame, 9))  # without the labels
        np.testing.assert_array_equal(copy, raw)
        assert dark.mean() < 0.2 * raw.mean()


def test_folders_of_other_tools_are_scored_and_black_is_unknown(
    chart_image: tuple[np.ndarray, np.ndarray], tmp_path: Path
) -> None:
    truth, corners = eight_bit(chart_image[0]), chart_image[1]
    for name, image in (
        ("perfect", truth),
        ("green", truth // np.array([2, 1, 2], np.uint8)),
        ("holed", truth.copy()),
    ):
        (tmp_path / name).mkdir()
        if name == "holed":
            image[: int(corners[:, 1].mean())] = 0
        cv2.imwrite(str(tmp_path / name / "a.png"), image[..., ::-1])
    found = OtherResults.of([tmp_path / name for name in ("perfect", "green", "holed")])
    assert found.corrected("b", SIZE) == {}
    assert found.missing(["a"]) == {}
    assert found.missing(["a", "b"]) == dict.fromkeys(("perfect", "green", "holed"), ("b",))
    target = chart("c", corners, SIZE)
    rows = {
        name: score_target("a", target, name, image, flat_range())
        for name, image in found.corrected("a", SIZE).items()
    }
    assert rows["perfect"].psi_deg < 1 < 10 < rows["green"].psi_deg
    assert rows["perfect"].ciede2000 < 1
    assert rows["holed"].pixels < 0.6 * rows["perfect"].pixels
    assert np.isfinite(rows["holed"].ciede2000)


@pytest.mark.slow
def test_wrong_folders_of_other_tools(
    folders: tuple[Path, Path], chart_image: tuple[np.ndarray, np.ndarray], tmp_path: Path
) -> None:
    corners = tmp_path / "targets.json"
    corners.write_text(json.dumps({"a": [{"chart": chart_image[1].tolist()}]}))
    for folder, size in (("x/out", SIZE), ("y/out", SIZE), ("small", (20, 30))):
        (tmp_path / folder).mkdir(parents=True)
        cv2.imwrite(str(tmp_path / folder / "a.png"), np.full((*size, 3), 90, np.uint8))
    with pytest.raises(InputError, match=r"another folder of results has the name 'out', too"):
        evaluate_charts(*folders, others=[tmp_path / "x/out", tmp_path / "y/out"])
    with pytest.raises(
        InputError, match=r"paper: a method of the table already has the name 'paper'"
    ):
        evaluate_charts(*folders, others=[tmp_path / "paper"])
    with pytest.raises(
        InputError, match=r"small/a\.png: is 30x20 px, but its source image is 320x240"
    ):
        evaluate_charts(*folders, targets=corners, others=[tmp_path / "small"])
    for folder, names in (("renamed", ["a_enhanced.png"]), ("twice", ["a.png", "a.jpg"])):
        (tmp_path / folder).mkdir()
        for name in names:
            cv2.imwrite(str(tmp_path / folder / name), np.full((*SIZE, 3), 90, np.uint8))
    with pytest.raises(
        InputError,
        match=r"renamed: none of its images has the name of .* first is 'a_enhanced', the first "
        r"to score is 'a'",
    ):
        evaluate_charts(*folders, targets=corners, others=[tmp_path / "renamed"])
    with pytest.raises(InputError, match=r"twice/a\.png: a\.jpg has the same name"):
        evaluate_charts(*folders, targets=corners, others=[tmp_path / "twice"])
    with pytest.raises(InputError, match="the folder of corrected images does not exist"):
        evaluate_charts(*folders, others=[tmp_path / "nowhere"])


@pytest.mark.slow
def test_given_corners_are_used_and_a_target_without_usable_pixels_is_named(
    folders: tuple[Path, Path], chart_image: tuple[np.ndarray, np.ndarray], tmp_path: Path
) -> None:
    file = tmp_path / "targets.json"
    beside_the_image = [[5000.0, 10.0], [5100.0, 10.0], [5100.0, 90.0]]
    file.write_text(
        json.dumps({"a": [{"chart": chart_image[1].tolist()}, {"polygon": beside_the_image}]})
    )
    report = evaluate_charts(*folders, file, FEW_STEPS)
    assert report.without_target == ("a: polygon 2", "b")
    assert {row.target for row in report.rows} == {"chart 1"}
    assert all(
        np.isfinite([row.psi_deg, row.ciede2000]).all() for row in (*report.rows, *report.means())
    )
    assert {row.target for row in report.means()} == {"mean of 1"}


def test_patches_of_unknown_range_are_left_out(chart_image: tuple[np.ndarray, np.ndarray]) -> None:
    image, corners = chart_image
    target = chart("c", corners, SIZE)
    known = score_target("f", target, "all", image * [0.4, 0.9, 1.0], flat_range())
    holed = image * [0.4, 0.9, 1.0]
    holed[target.patches[0] | target.patches[20]] = np.nan
    row = score_target("f", target, "holed", holed, flat_range())
    assert row.psi_deg == pytest.approx(known.psi_deg, abs=1.5)
    assert row.ciede2000 == pytest.approx(known.ciede2000, abs=2)
    nothing = score_target("f", target, "nothing", np.full_like(image, np.nan), flat_range())
    assert np.isnan(
        [nothing.psi_deg, nothing.psi_linear_deg, nothing.ciede2000, nothing.clipped_fraction]
    ).all()
    assert nothing.pixels == 0
    (mean,) = ChartReport((row, replace(nothing, method="holed")), ()).means()
    assert (mean.psi_deg, mean.target) == (row.psi_deg, "mean of 1")


@pytest.mark.slow
def test_images_without_a_chart_are_named(folders: tuple[Path, Path]) -> None:
    (folders[0] / "a.tiff").unlink()
    (folders[1] / "a.tiff").unlink()
    with pytest.raises(InputError, match="no color chart was found in 1 image:"):
        evaluate_charts(*folders)


@pytest.mark.slow
def test_targets_of_other_images_are_named(folders: tuple[Path, Path], tmp_path: Path) -> None:
    file = tmp_path / "targets.json"
    file.write_text("{}")
    with pytest.raises(InputError, match=r"targets\.json: none of its targets"):
        evaluate_charts(*folders, targets=file)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("[", "targets.json: is not JSON"),
        ("[1]", "must hold"),
        ('{"a": [{"circle": [[0, 0], [1, 1], [2, 0]]}]}', "is one polygon, chart, dkk or spyder"),
        ('{"a": [{"polygon": [[0, 0], [1, 1]]}]}', "3 corners or more"),
        ('{"a": [{"chart": [[0, 0], [1, 1], [2, 0]]}]}', "a chart its 4"),
        ('{"a": [{"polygon": "here"}]}', "is one polygon, chart, dkk or spyder"),
        ('{"a": [{}]}', "is one polygon, chart, dkk or spyder"),
    ],
)
def test_bad_targets_are_named(tmp_path: Path, content: str, message: str) -> None:
    file = tmp_path / "targets.json"
    file.write_text(content)
    with pytest.raises(InputError, match=message):
        read_targets(file)


@pytest.mark.slow
@pytest.mark.real_data
def test_white_cards_in_the_sea(real_data: Path) -> None:
    flsea = real_data / "flsea"
    report = evaluate_charts(flsea / "rgb", flsea / "range", flsea / "neutral_targets.json")
    means = {row.method: row for row in report.means()}
    ours = means.pop(OURS)
    assert ours.psi_deg < 4
    assert max(row.clipped_fraction for row in report.rows if row.method == OURS) <= 0.02
    assert all(ours.psi_deg < other.psi_deg for other in means.values())
    assert len(report.without_target) == 6


@pytest.mark.slow
def test_unknown_ranges_are_left_out_by_ours(chart_image: tuple[np.ndarray, np.ndarray]) -> None:
    range_m = flat_range()
    range_m[:, :100] = np.nan
    results = correct_by_all(eight_bit(chart_image[0]), range_m, FEW_STEPS)
    assert np.isnan(results[OURS][:, :100]).all()
    assert np.isfinite(results[OURS][:, 100:]).all()


@pytest.mark.slow
def test_a_patch_that_fades_with_range_is_spread(
    chart_image: tuple[np.ndarray, np.ndarray],
) -> None:
    image, corners = chart_image
    target, none = chart("c", corners, SIZE), np.zeros(SIZE, np.bool_)
    true = [
        seen_chart("true", target, image, np.full(SIZE, meters, np.float32), none)
        for meters in (1, 3)
    ]
    cast = encode_srgb(decode_srgb(image) * [0.5, 1, 1])
    faded = [
        seen_chart("faded", target, picture, np.full(SIZE, 2.0, np.float32), none)
        for picture in (image, cast)
    ]
    seen = [one for one in (*true, *faded) if one]
    alike, spread = spread_over_charts(seen)
    assert (alike.method, alike.charts, alike.nearest_m, alike.farthest_m) == ("true", 2, 1, 3)
    assert (alike.angle_deg, alike.luminance) == (
        pytest.approx(0, abs=1e-4),
        pytest.approx(0, abs=1e-9),
    )
    assert spread.angle_deg > 5
    assert spread_over_charts(seen[:1]) == ()
    first = none.copy()
    first[target.patches[0]] = True
    clipped = seen_chart("c", target, image, flat_range(), first)
    assert clipped is not None
    assert np.isnan(clipped.colors).any(axis=1).tolist() == [True] + [False] * (
        len(target.patches) - 1
    )
    assert (
        seen_chart(
            "n", neutral("w", corners, eight_bit(image), flat_range()), image, flat_range(), none
        )
        is None
    )


def test_names_of_frames_and_methods_are_written_whole_in_a_table() -> None:
    name = "reef_1790000001000" * 6
    assert table(("frame", "method"), [(name, OURS)]).splitlines()[1].split() == [name, OURS]
