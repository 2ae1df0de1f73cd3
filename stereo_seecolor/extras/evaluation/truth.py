"""Errors of a finished run's ranges and colors against truth, beside the raw images'."""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from calibration import Rectification, RectifiedPair
from calibration.formats import load_rig
from stereo_seecolor.errors import InputError
from stereo_seecolor.extras.evaluation.measures import TruthScore, score_truth
from stereo_seecolor.files.decode import read_array
from stereo_seecolor.files.json_records import load_object
from stereo_seecolor.files.srgb import encode_srgb
from stereo_seecolor.inputs.images import read_image, read_range_map
from stereo_seecolor.records import Map, Mask

Score = TypeVar("Score", "RangeScore", TruthScore)
NOT_MEASURED = (1, 2)
"""Codes of OUT/mask for ranges that are unknown or filled in."""


@dataclass(frozen=True)
class RangeScore:
    """Errors of measured ranges, without filled-in ones.

    median_relative_error: |range - truth| / truth. bad_1_px, bad_2_px: fraction of measured pixels
    whose disparity is off by more.
    coverage: fraction of the pixels that both cameras see which were measured.
    """

    median_relative_error: float
    bad_1_px: float
    bad_2_px: float
    coverage: float


@dataclass(frozen=True)
class ResultFiles:
    """Results of a frame. mask: codes as run writes them; None: all known ranges are measured."""

    range_m: Path
    corrected: Path
    mask: Path | None = None


@dataclass(frozen=True)
class FrameScore:
    """Scores of one frame. color, raw_color: corrected and raw, over the same pixels."""

    name: str
    range: RangeScore
    color: TruthScore
    raw_color: TruthScore


@dataclass(frozen=True)
class TruthReport:
    """Scores of a run, means over the frames. missing: names of frames without a result."""

    frames: tuple[FrameScore, ...]
    missing: tuple[str, ...]
    range: RangeScore
    color: TruthScore
    raw_color: TruthScore


def true_frames(truth: Path) -> list[str]:
    """Names of the frames whose truth the folder holds, sorted. Raises InputError if none."""
    names = sorted(path.stem for path in (truth / "range").glob("*.tiff"))
    if not names:
        raise InputError(
            f"{truth}: holds no range/*.tiff: give the truth folder of a dive that "
            "'stereo-seecolor synthesize' made"
        )
    return names


def evaluate_truth(results: Mapping[str, ResultFiles], truth: Path) -> TruthReport:
    """Compare results, by frame name, with the truth of a dive (docs/synthetic.md), whose left/ and
    cam.yaml lie beside ``truth``.

    Colors are compared as displayed (sRGB), over pixels whose range was measured and whose true
    color is neither clipped nor so dark (brightest channel below 6 % of full scale, encoded) that
    noise makes its hue.

    Raises InputError if ``truth`` is not such a folder, holds none of these frames, or a result has
    another size than its truth.
    """
    names = true_frames(truth)
    if results.keys().isdisjoint(names):
        raise InputError(
            f"there is no result for any of the {len(names)} frames of {truth}: run the same dive "
            "first"
        )
    rectification = Rectification.from_rig(load_rig(truth.parent / "cam.yaml"))
    linear = _is_linear(truth)
    frames = tuple(
        _score_frame(results[name], truth, name, rectification, linear)
        for name in names
        if name in results
    )
    return TruthReport(
        frames,
        tuple(name for name in names if name not in results),
        _mean(RangeScore, [frame.range for frame in frames]),
        _mean(TruthScore, [frame.color for frame in frames]),
        _mean(TruthScore, [frame.raw_color for frame in frames]),
    )


def score_range(range_m: Map, true_m: Map, visible: Mask, geometry: RectifiedPair) -> RangeScore:
    """Score of a range map (H, W), NaN if unknown, against truth; visible: to both cameras."""
    known = np.isfinite(range_m) & np.isfinite(true_m)
    disparity, true_disparity = (
        geometry.disparity_from_depth(geometry.depth_from_range(z)) for z in (range_m, true_m)
    )
    off_px = np.abs(disparity - true_disparity)[known]
    relative = (np.abs(range_m - true_m) / true_m)[known]
    nan = float("nan")
    return RangeScore(
        median_relative_error=float(np.median(relative)) if known.any() else nan,
        bad_1_px=float((off_px > 1).mean()) if known.any() else nan,
        bad_2_px=float((off_px > 2).mean()) if known.any() else nan,
        coverage=float(known[visible].mean()) if visible.any() else nan,
    )


def _score_frame(
    result: ResultFiles, truth: Path, name: str, rectification: Rectification, linear: bool
) -> FrameScore:
    """The scores of one frame. linear: the dive's images are. Raises InputError for other sizes."""
    true_m = read_range_map(truth / "range" / f"{name}.tiff")
    range_m = _of_size(read_range_map(result.range_m), result.range_m, true_m)
    measured = np.isfinite(range_m)
    if result.mask is not None:
        mask = _of_size(read_image(result.mask), result.mask, true_m)
        measured &= ~np.isin(mask[..., 0], NOT_MEASURED)
    measured_m = np.where(measured, range_m, np.float32(np.nan))
    seen = truth / "visible" / f"{name}.png"
    visible = _of_size(read_image(seen), seen, true_m)[..., 0] > 0

    shown = truth / "color" / f"{name}.png"
    color = _of_size(_displayed(shown, linear), shown, true_m)
    raw = rectification.upright(
        rectification.apply_left(read_image(truth.parent / "left" / f"{name}.png"))
    )
    scores = []
    corrected = _of_size(_displayed(result.corrected, linear=False), result.corrected, true_m)
    for image in (corrected, _as_displayed(raw, linear)):
        known = np.where(measured[..., None], image, np.nan)
        scores.append(score_truth(known, color, true_m))
    return FrameScore(name, score_range(measured_m, true_m, visible, rectification.pair), *scores)


def _displayed(path: Path, linear: bool) -> NDArray[np.float64]:
    """(H, W, 3) in sRGB as a fraction of full scale; float TIFFs are linear."""
    if path.suffix == ".tiff":
        return encode_srgb(np.clip(read_array(path), 0, 1))
    return _as_displayed(read_image(path), linear)


def _as_displayed(image: NDArray[np.unsignedinteger], linear: bool) -> NDArray[np.float64]:
    fraction = image / np.iinfo(image.dtype).max
    return encode_srgb(fraction) if linear else np.asarray(fraction)


def _is_linear(truth: Path) -> bool:
    try:
        return bool(load_object(truth / "water.json")["water"]["input_encoding"] == "linear")
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise InputError(
            f"{truth / 'water.json'}: does not state how the images are encoded: {error}"
        ) from error


def _mean(kind: type[Score], scores: list[Score]) -> Score:
    names = [field.name for field in fields(kind)]
    values = np.array(
        [[getattr(score, name) for name in names] for score in scores], dtype=np.float64
    )
    known = np.isfinite(values)
    with np.errstate(invalid="ignore"):
        means = np.where(known, values, 0).sum(axis=0) / known.sum(axis=0)
    return kind(**dict(zip(names, means.tolist(), strict=True)))


def _of_size(pixels: NDArray[Any], path: Path, true_m: Map) -> NDArray[Any]:
    """The pixels of a file. Raises InputError where their size is not that of the truth."""
    if pixels.shape[:2] != true_m.shape:
        raise InputError(f"{path}: is {_size(pixels)} pixels, but its truth is {_size(true_m)}")
    return pixels


def _size(values: NDArray[Any]) -> str:
    return f"{values.shape[1]}x{values.shape[0]}"
