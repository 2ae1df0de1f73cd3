"""Where a survey's images and ranges come from: stereo pairs that are matched, or images with range maps that people bring."""

import hashlib
from pathlib import Path

import numpy as np

from calibration import RectifiedPair
from stereo_seecolor.compute.threads import Clock
from stereo_seecolor.config import RunConfig
from stereo_seecolor.errors import InputError, MatchingError
from stereo_seecolor.files.atomic import write_atomic
from stereo_seecolor.files.encode import encode_image
from stereo_seecolor.inputs.images import decode_image, read_image, read_image_bytes, read_range_map
from stereo_seecolor.inputs.pairing import Pair
from stereo_seecolor.pipeline import Done, Pipeline, Ranged
from stereo_seecolor.records import Image, Map, Mask, RangeMap, StereoFrame
from stereo_seecolor.run_folder.folder import Finished, RunFolder, content_key
from stereo_seecolor.run_folder.frames_table import FrameRow
from stereo_seecolor.run_folder.products import range_outputs, write_range
from stereo_seecolor.version import __version__


class StereoSource:
    """Pairs of images: matched once, and from then on read back from the run folder."""

    def __init__(self, pipeline: Pipeline, folder: RunFolder) -> None:
        rectification = pipeline.rectification
        self.geometry: RectifiedPair | None = rectification.pair
        self._pipeline = pipeline
        self._folder = folder
        self._matched: set[str] = set()
        config = pipeline.config
        self._settings = content_key(
            __version__,
            repr(self.geometry),
            *(table.tobytes() for maps in (rectification.maps_left, rectification.maps_right) if maps for table in maps),
            config.input.model_dump(),
            config.matching.model_dump(),
            config.output.range_std,
        )

    def ranged(self, pair: Pair, clock: Clock) -> Ranged:
        """The rectified left image and its range map. Raises InputError, MatchingError, CalibrationError, OutputError."""
        with clock("read"):
            left, right = read_image_bytes(pair.left), read_image_bytes(pair.right)
            hashes = {"left": hashlib.sha256(left).hexdigest(), "right": hashlib.sha256(right).hexdigest()}
            if hashes["left"] == hashes["right"]:
                raise MatchingError(f"{pair.left} and {pair.right} are the same picture: no range can be had from it")
            key = content_key(hashes, self._settings)
            done = self._folder.finished("range", pair.name, key, self._outputs(pair))
        kept = self._kept(pair, left, done, clock) if done else None
        image, range_map = kept or self._match(pair, left, right, key, clock)
        return Ranged(image, range_map, key, hashes, kept=pair.name not in self._matched)

    def _outputs(self, pair: Pair) -> list[Path]:
        return range_outputs(self._folder, pair.name, self._pipeline.config.output)

    def _kept(self, pair: Pair, left: bytes, done: Finished, clock: Clock) -> tuple[Image, RangeMap] | None:
        """What an earlier run matched; None where its files have been damaged since."""
        with clock("read"):
            image = decode_image(left, pair.left, self._pipeline.config.input)
            try:
                range_m = read_range_map(self._folder.range(pair.name))
                measured = read_image(self._folder.confidence(pair.name))[..., 0] > 0
            except InputError:
                return None
        with clock("rectify"):
            image = self._pipeline.rectification.apply_left(image)
        return image, only_ranges(range_m, measured, done.warnings)

    def _match(self, pair: Pair, left: bytes, right: bytes, key: str, clock: Clock) -> tuple[Image, RangeMap]:
        with clock("read"):
            images = [decode_image(c, p, self._pipeline.config.input) for c, p in ((left, pair.left), (right, pair.right))]
            raw = StereoFrame(pair.name, images[0], images[1], pair.timestamp_s)
        with clock("rectify"):
            frame = self._pipeline.rectify(raw)
        with clock("match"):
            range_map = self._pipeline.match(frame)
            self._pipeline.check_pair(raw, range_map)
        with clock("write"):
            write_range(self._folder, pair.name, range_map, self._pipeline.config.output)
            self._folder.finish("range", pair.name, Finished(key, warnings=range_map.warnings))
        self._matched.add(pair.name)
        return frame.left, range_map

    def write_rectified(self, pair: Pair, clock: Clock) -> Done:
        """Write both rectified images of a pair."""
        config = self._pipeline.config
        with clock("read"):
            left, right = read_image(pair.left, config.input), read_image(pair.right, config.input)
        with clock("rectify"):
            frame = self._pipeline.rectify(StereoFrame(pair.name, left, right))
        with clock("write"):
            for side, image in (("left", frame.left), ("right", frame.right)):
                write_atomic(self._folder.rectified(side, pair.name), encode_image(image, "png"))
        return Done(FrameRow(pair.name))


class RangedSource:
    """Images with the range maps that somebody else made, pixel for pixel."""

    geometry: RectifiedPair | None = None

    def __init__(self, config: RunConfig) -> None:
        self._config = config

    def ranged(self, pair: Pair, clock: Clock) -> Ranged:
        """The image as it is and its range map. Raises InputError if they differ in size or cannot be read."""
        with clock("read"):
            content = read_image_bytes(pair.left)
            image = decode_image(content, pair.left, self._config.input)
            range_m = read_range_map(pair.right)
        if range_m.shape != image.shape[:2]:
            raise InputError(
                f"{pair.right}: the range map is {range_m.shape[1]}x{range_m.shape[0]} px but its image {pair.left.name} is "
                f"{image.shape[1]}x{image.shape[0]}: give the range map of this very image"
            )
        hashes = {"image": hashlib.sha256(content).hexdigest(), "range": hashlib.sha256(range_m.tobytes()).hexdigest()}
        key = content_key(__version__, hashes, self._config.input.model_dump())
        return Ranged(image, only_ranges(range_m, np.isfinite(range_m)), key, hashes)


def only_ranges(range_m: Map, measured: Mask, warnings: tuple[str, ...] = ()) -> RangeMap:
    """A range map of which nothing but the ranges is known, and which of them were measured: the rest is NaN."""
    nothing = np.full_like(range_m, np.nan)
    known = np.isfinite(range_m)
    return RangeMap(nothing, nothing, range_m, nothing, (known & measured).astype(np.float32), known & ~measured, warnings)
