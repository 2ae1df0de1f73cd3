"""Scores of each color method on targets of known color: rows of a table, and a contact sheet."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.errors import counted
from stereo_seecolor.checks.camera_response import settle_response
from stereo_seecolor.color.corrector import Corrector
from stereo_seecolor.color.response.response import Response, standard_config
from stereo_seecolor.config import RunConfig
from stereo_seecolor.errors import InputError
from stereo_seecolor.extras.evaluation.baselines import METHODS, OURS, PAPER
from stereo_seecolor.extras.evaluation.charts.chart_spread import (
    SeenChart,
    SpreadRow,
    seen_chart,
    spread_over_charts,
)
from stereo_seecolor.extras.evaluation.charts.targets import Target, read_targets, targets_of
from stereo_seecolor.extras.evaluation.measures import (
    clipped,
    color_differences,
    exposure_gain,
    lab_from_linear,
    score_neutral,
)
from stereo_seecolor.extras.evaluation.other_results import OtherResults
from stereo_seecolor.files.atomic import write_atomic
from stereo_seecolor.files.free_places import refuse_existing
from stereo_seecolor.files.srgb import LUMINANCE, decode_srgb
from stereo_seecolor.inputs.images import read_image, read_range_map
from stereo_seecolor.inputs.pairing import Pair, pair_by_stem
from stereo_seecolor.records import Image, Map

_TILE_WIDTH, _LABEL_HEIGHT = 320, 22


@dataclass(frozen=True)
class ChartRow:
    """Scores of a method on a target.

    range_m: median distance, NaN where unknown. psi_deg: mean angle to gray of its neutral patches
    as displayed, degrees; psi_linear_deg: the same in linear light. ciede2000: median over its
    patches after one exposure gain, to the chart's published colors, or for a white object to gray
    of the same brightness. clipped_fraction: of its pixels. chroma: median C*ab of the whole frame,
    to be read with psi: an image without colors has psi 0. pixels: number of the target's pixels.
    """

    frame: str
    target: str
    method: str
    range_m: float
    psi_deg: float
    psi_linear_deg: float
    ciede2000: float
    clipped_fraction: float
    chroma: float
    pixels: int


@dataclass(frozen=True)
class ChartReport:
    """Scores on charts. rows: every method on every target. spreads: every method over charts at
    several ranges. sheet: if written.

    missing: other tool -> frames with targets that it has no image of, so that its means are over
    fewer targets.
    without_target: frames that had none, and "frame: target" of targets without one pixel to score
    (clipped, dark, range unknown).
    """

    rows: tuple[ChartRow, ...]
    without_target: tuple[str, ...]
    sheet: Path | None = None
    spreads: tuple[SpreadRow, ...] = ()
    missing: dict[str, tuple[str, ...]] = field(default_factory=dict)

    def means(self) -> tuple[ChartRow, ...]:
        """A row for each method: means over targets with pixels to score; pixels are added up."""
        methods = dict.fromkeys(row.method for row in self.rows)
        return tuple(
            _mean(method, [row for row in self.rows if row.method == method]) for method in methods
        )


def evaluate_charts(
    images: Path,
    ranges: Path,
    targets: Path | None = None,
    config: RunConfig | None = None,
    sheet: Path | None = None,
    others: Sequence[str | Path] = (),
) -> ChartReport:
    """Score every method on every target in a folder of images with range maps of the same stems.

    targets: JSON of polygons and chart corners (see ``read_targets``); only images that it names
    are scored. Without it each image is searched for charts. sheet: the contact sheet to write (a
    new PNG). others: folders of the images as other tools corrected them, under the same names.
    Raises InputError, also where there is no target; OutputError.
    """
    if sheet:
        refuse_existing(sheet, option="--sheet")
    config, results = config or RunConfig(), OtherResults.of(others)
    given = read_targets(targets) if targets else {}
    pairs = pair_by_stem(images, ranges).pairs
    results.refuse_other_names([pair.left.stem for pair in pairs])
    config, _ = settle_response(config, pairs, has_right=False)
    frames = [
        _scored(pair, given.get(pair.left.stem) if targets else [], results, config)
        for pair in pairs
    ]
    rows = tuple(row for frame in frames for row in frame.rows)
    without = tuple(name for frame in frames for name in frame.without)
    if not rows:
        raise InputError(_nothing_found(images, targets, len(without)))
    if sheet:
        write_atomic(sheet, _sheet([frame.tiles for frame in frames if frame.tiles]))
    scored = [pair.left.stem for pair, frame in zip(pairs, frames, strict=True) if frame.rows]
    spreads = spread_over_charts([chart for frame in frames for chart in frame.seen])
    return ChartReport(rows, without, sheet, spreads, results.missing(scored))


@dataclass(frozen=True, eq=False)
class _ScoredFrame:
    """The scores of one frame. without: names of targets that could not be scored. tiles: method ->
    its image, for the sheet.
    """

    rows: list[ChartRow] = field(default_factory=list)
    without: list[str] = field(default_factory=list)
    tiles: dict[str, NDArray[np.uint8]] = field(default_factory=dict)
    seen: list[SeenChart] = field(default_factory=list)


def _scored(
    pair: Pair,
    named: list[dict[str, NDArray[np.float64]]] | None,
    results: OtherResults,
    config: RunConfig,
) -> _ScoredFrame:
    """Score every method on the targets of a frame. named: from the file of targets, None where it
    does not name this frame.
    """
    image = read_image(pair.left, config.input)
    image = Response.of(config.color).of_frame(image).standard(image)
    range_m = read_range_map(pair.right, config.input.range_units_per_m)
    if range_m.shape != image.shape[:2]:
        raise InputError(f"{pair.right}: has another size than its image {pair.left.name}")
    found = [] if named is None else targets_of(named, image, range_m)
    usable = [target for target in found if target.mask.any()]
    if not usable:
        return _ScoredFrame(without=[pair.name])
    corrected = correct_by_all(image, range_m, config) | results.corrected(
        pair.left.stem, image.shape
    )
    each = [(target, method, result) for target in usable for method, result in corrected.items()]
    full = clipped(image / float(np.iinfo(image.dtype).max))
    charts = (seen_chart(method, target, result, range_m, full) for target, method, result in each)
    return _ScoredFrame(
        [
            score_target(pair.name, target, method, result, range_m)
            for target, method, result in each
        ],
        [f"{pair.name}: {target.name}" for target in found if not target.mask.any()],
        {method: _tile(f"{pair.name}  {method}", result) for method, result in corrected.items()},
        [chart for chart in charts if chart],
    )


def _nothing_found(images: Path, targets: Path | None, number: int) -> str:
    if targets:
        return (
            f"{targets}: none of its targets is visible with a known range in the {number} "
            f"images of {images}"
        )
    return (
        f"{images}: no color chart was found in {counted(number, 'image')}: give its corners "
        "with --targets"
    )


def correct_by_all(image: Image, range_m: Map, config: RunConfig) -> dict[str, NDArray[np.float64]]:
    """Method -> corrected image (H, W, 3) in [0, 1] as displayed, NaN where it leaves a pixel out.

    image: as ``Response.standard`` encoded it, for every method.
    """
    fractions = image / float(np.iinfo(image.dtype).max)
    results = {
        name: np.minimum(method(fractions, range_m.astype(np.float64)), 1.0)
        for name, method in METHODS.items()
    }
    for name, color in (
        (PAPER, config.color.model_copy(update={"method": "paper"})),
        (OURS, config.color),
    ):
        corrector = Corrector(standard_config(color))
        done = corrector.apply(image, range_m, corrector.fit_frame(image, range_m))
        results[name] = np.where(
            done.unknown[..., None], np.nan, done.image / float(np.iinfo(image.dtype).max)
        )
    return results


def score_target(
    frame: str, target: Target, method: str, result: NDArray[np.float64], range_m: Map
) -> ChartRow:
    """A method's scores on a target. Unknown patches are left out; NaN where all are."""
    colors = [result[patch] for patch in target.patches]
    grays = colors if target.type is None else colors[target.type.grays]
    whole = np.concatenate(colors)
    known = np.isfinite(whole).all(axis=-1)
    seen = range_m[target.mask]
    return ChartRow(
        frame=frame,
        target=target.name,
        method=method,
        range_m=float(np.nanmedian(seen)) if np.isfinite(seen).any() else float("nan"),
        psi_deg=_mean_of([score_neutral(pixels).psi_deg for pixels in grays]),
        psi_linear_deg=_mean_of([score_neutral(decode_srgb(pixels)).psi_deg for pixels in grays]),
        ciede2000=_difference(colors, target.type.srgb if target.type else None),
        clipped_fraction=float(clipped(whole[known]).mean()) if known.any() else float("nan"),
        chroma=_chroma(result),
        pixels=int(known.sum()),
    )


def _chroma(result: NDArray[np.float64]) -> float:
    """Median C*ab of every fourth pixel of every fourth row; NaN where none is known."""
    pixels = result[::4, ::4].reshape(-1, 3)
    known = pixels[np.isfinite(pixels).all(axis=-1)]
    return (
        float(np.median(np.hypot(*lab_from_linear(decode_srgb(known))[:, 1:].T)))
        if len(known)
        else float("nan")
    )


def _difference(colors: Sequence[NDArray[np.float64]], srgb: NDArray[np.float64] | None) -> float:
    known = [pixels[np.isfinite(pixels).all(axis=-1)] for pixels in colors]
    seen = [patch for patch, pixels in enumerate(known) if len(pixels)]
    if not seen:
        return float("nan")
    means = np.stack([decode_srgb(known[patch]).mean(axis=0) for patch in seen])
    truth = (
        np.repeat(means @ LUMINANCE[:, None], 3, axis=1)
        if srgb is None
        else decode_srgb(srgb[seen])
    )
    exposed = means * exposure_gain(means, truth) if srgb is not None else means
    return float(np.median(color_differences(exposed, truth)))


def _mean(method: str, rows: Sequence[ChartRow]) -> ChartRow:
    keys = ("range_m", "psi_deg", "psi_linear_deg", "ciede2000", "clipped_fraction", "chroma")
    number = {key: _mean_of([getattr(row, key) for row in rows]) for key in keys}
    scored = sum(row.pixels > 0 for row in rows)
    return ChartRow(
        "all", f"mean of {scored}", method, pixels=sum(row.pixels for row in rows), **number
    )


def _mean_of(values: Sequence[float]) -> float:
    """Mean of the values that are known, NaN if none is."""
    known = [value for value in values if np.isfinite(value)]
    return float(np.mean(known)) if known else float("nan")


def _tile(label: str, result: NDArray[np.float64]) -> NDArray[np.uint8]:
    height = round(_TILE_WIDTH * result.shape[0] / result.shape[1])
    shown = (np.clip(np.nan_to_num(result), 0, 1) * 255).astype(np.uint8)
    picture = cv2.resize(shown, (_TILE_WIDTH, height), interpolation=cv2.INTER_AREA)
    strip = np.full((_LABEL_HEIGHT, _TILE_WIDTH, 3), 30, np.uint8)
    cv2.putText(
        strip,
        label,
        (4, _LABEL_HEIGHT - 7),
        cv2.FONT_HERSHEY_SIMPLEX,
        0.42,
        (255, 255, 255),
        1,
        cv2.LINE_AA,
    )
    return np.concatenate([strip, picture])


def _sheet(tiles: Sequence[Mapping[str, NDArray[np.uint8]]]) -> bytes:
    """A PNG with a row for each frame and a column for each method, black where one lacks the
    frame. tiles: by frame and method.
    """
    methods = dict.fromkeys(method for frame in tiles for method in frame)
    tall = max(tile.shape[0] for frame in tiles for tile in frame.values())
    empty = np.zeros((tall, _TILE_WIDTH, 3), np.uint8)
    rows = [[frame.get(method, empty) for method in methods] for frame in tiles]
    padded = [
        np.hstack([np.pad(tile, ((0, tall - tile.shape[0]), (0, 0), (0, 0))) for tile in row])
        for row in rows
    ]
    return bytes(cv2.imencode(".png", np.vstack(padded)[..., ::-1])[1])
