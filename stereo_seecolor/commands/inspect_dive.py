"""Measurements of sample pairs of a dive: whether they show one scene, distance of the bottom,
light, disk space and time of a run.
"""

import time
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from calibration import Rectification, StereoRig
from calibration.verification.same_scene import images_overlap
from stereo_seecolor.checks.neighbors import neighbor_that_fits
from stereo_seecolor.config import RunConfig
from stereo_seecolor.errors import InputError, SeeColorError
from stereo_seecolor.files.srgb import decode_srgb
from stereo_seecolor.inputs.frame_reader import FrameReader
from stereo_seecolor.inputs.pairing import Pair, Pairing
from stereo_seecolor.matching.image_texture import sides_without_texture
from stereo_seecolor.pipeline import Pipeline
from stereo_seecolor.records import Array, FrameResult, Image, StereoFrame
from stereo_seecolor.run_folder.pair_files import correction_files, range_files

STROBE_CENTER_TO_CORNER = 1.6
"""Mean brightness, middle over corners: 2.1 on a strobe-lit dive, 1.1 and 1.2 in daylight."""

PASSES_THAT_READ = 2
"""A run reads every pair once to measure and once to correct."""

PAGE_BYTES, PAGE_FRAMES, PAGE_FRACTION = 1_100_000, 30, 0.1
"""Size of the page's scripts; frames it has pictures of; their size as a fraction of a frame's
files (of the sample dive).
"""


@dataclass(frozen=True)
class Misfit:
    """A pair whose images do not show one scene. fits: the pair with the right image, if any."""

    pair: str
    fits: str | None


@dataclass(frozen=True)
class SampleMeasures:
    """Measures of sample pairs. coverage: fraction of pixels with a range. ground_resolution_m: a
    pixel's size at the median range.

    center_to_corner: mean brightness of the middle over that of the corners (linear light).
    strobes: center_to_corner is that of lamps. disk_bytes, seconds: estimated for the whole dive
    with the default settings: the files of a run; ranges and colors on this machine.
    """

    coverage: float
    median_range_m: float
    ground_resolution_m: float
    center_to_corner: float
    strobes: bool
    disk_bytes: int
    seconds: float


def alike(
    sample: Sequence[Pair], reader: FrameReader
) -> tuple[dict[Pair, StereoFrame], tuple[str, ...]]:
    """The sample pairs whose images can be read and have the most frequent sizes, and a line on
    each other one.

    No lines where none can be read.
    """
    frames, notes = dict[Pair, StereoFrame](), []
    for pair in sample:
        try:
            frames[pair] = reader.read(pair)
        except InputError as error:
            notes.append(f"{error}; a run leaves that pair out")
    if not frames:
        return {}, ()
    sizes = {
        pair: (frame.left.shape[1::-1], frame.right.shape[1::-1]) for pair, frame in frames.items()
    }
    usual = Counter(sizes.values()).most_common(1)[0][0]
    for pair, found in sizes.items():
        for file, size, other in zip((pair.left, pair.right), found, usual, strict=True):
            if size != other:
                notes.append(f"{file}: {_unlike(size, other)}; a run leaves that pair out")
    return {pair: frames[pair] for pair, found in sizes.items() if found == usual}, tuple(notes)


def _unlike(size: tuple[int, ...], other: tuple[int, ...]) -> str:
    text = f"is {size[0]}x{size[1]} px, and most images are {other[0]}x{other[1]} px"
    turned = ": rotated by 90 degrees, perhaps only by its EXIF orientation"
    return f"{text}{turned if size == other[::-1] else ''}"


def misfits(
    rig: StereoRig, pairing: Pairing, sample: Mapping[Pair, StereoFrame], config: RunConfig
) -> tuple[Misfit, ...]:
    """The sample pairs whose two images do not show one scene.

    Empty where no pair shows one and no neighbor fits: then the rig is wrong. Pairs without texture
    (open water, even sand) are left out.
    """
    rectification = Rectification.from_rig(rig)
    found, fitting = [], 0
    for pair, frame in sample.items():
        if images_overlap(rectification, frame.left, frame.right):
            fitting += 1
        elif not sides_without_texture(frame):
            other = neighbor_that_fits(pair, pairing.pairs, rectification, config.input)
            found.append(Misfit(pair.name, other.name if other else None))
    rig_is_wrong = not fitting and not any(misfit.fits for misfit in found)
    return () if rig_is_wrong else tuple(found)


def measure(
    rig: StereoRig, sample: Sequence[Pair], pairs: int, config: RunConfig
) -> SampleMeasures | None:
    """Run the sample pairs in memory; None if none of them goes through."""
    pipeline, reader = Pipeline(rig, config), FrameReader(config.input)
    processed = [one for pair in sample if (one := _processed(pipeline, reader, pair))]
    if not processed:
        return None
    results, seconds = zip(*processed, strict=True)
    known = [np.isfinite(result.range_map.range_m) for result in results]
    medians_m = [
        float(np.median(one.range_map.range_m[of]))
        for one, of in zip(results, known, strict=True)
        if of.any()
    ]
    median_range_m = float(np.median(medians_m)) if medians_m else float("nan")
    frame_bytes = int(np.mean([_bytes_written(result, pipeline) for result in results]))
    page_bytes = PAGE_BYTES + int(PAGE_FRACTION * min(pairs, PAGE_FRAMES) * frame_bytes)
    brightness = _center_to_corner([result.frame.left for result in results])
    return SampleMeasures(
        coverage=float(np.mean([of.mean() for of in known])),
        median_range_m=median_range_m,
        ground_resolution_m=median_range_m / float(pipeline.rectification.pair.focal_px),
        center_to_corner=brightness,
        strobes=brightness > STROBE_CENTER_TO_CORNER,
        disk_bytes=pairs * frame_bytes + page_bytes,
        seconds=pairs * min(seconds),
    )


def _processed(
    pipeline: Pipeline, reader: FrameReader, pair: Pair
) -> tuple[FrameResult, float] | None:
    """The result of a pair through all stages, and its seconds; None if it fails."""
    start = time.perf_counter()
    frame = reader.read(pair)
    read_s = time.perf_counter() - start
    try:
        result = pipeline.process(frame)
    except SeeColorError:
        return None
    _bytes_written(result, pipeline)
    return result, time.perf_counter() - start + (PASSES_THAT_READ - 1) * read_s


def _bytes_written(result: FrameResult, pipeline: Pipeline) -> int:
    output = pipeline.config.output
    files = range_files("", result.range_map, output)
    files |= correction_files(
        "", result.correction, result.range_map, pipeline.geometry, output, b""
    )
    return sum(
        len(b"".join(content)) for _, content in files.values() if isinstance(content, Iterator)
    )


def _center_to_corner(images: Sequence[Image]) -> float:
    mean = np.mean([_small(image) for image in images], axis=0)
    rows, columns = mean.shape[0] // 6, mean.shape[1] // 6
    corners = [
        mean[:rows, :columns],
        mean[:rows, -columns:],
        mean[-rows:, :columns],
        mean[-rows:, -columns:],
    ]
    middle = mean[2 * rows : -2 * rows, 2 * columns : -2 * columns]
    return float(middle.mean() / max(float(np.mean([corner.mean() for corner in corners])), 1e-6))


def _small(image: Image) -> Array:
    """Green in linear light, (24, 32)."""
    green = decode_srgb(image[..., 1].astype(np.float64) / np.iinfo(image.dtype).max)
    return np.asarray(cv2.resize(green, (32, 24), interpolation=cv2.INTER_AREA))
