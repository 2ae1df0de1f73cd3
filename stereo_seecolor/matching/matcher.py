"""The matching stage: ``Matcher`` computes the range map of a rectified pair."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from calibration.geometry import RectifiedPair
from stereo_seecolor.compute.threads import core_pool
from stereo_seecolor.config import MatchingConfig
from stereo_seecolor.matching import diagnostics
from stereo_seecolor.matching.confidence import judge_rows, least_odds, surroundings, weigh_rows
from stereo_seecolor.matching.context import Context
from stereo_seecolor.matching.disparity import UNKNOWN, Engine, MatchedDisparity
from stereo_seecolor.matching.fattening import fattening
from stereo_seecolor.matching.gray import LARGE_IMAGE_PX, Gray, GrayPair
from stereo_seecolor.matching.interpolation import fill
from stereo_seecolor.matching.refine import contrast_gain, error_factor, refine_rows
from stereo_seecolor.matching.sgm.search import SemiGlobalMatching
from stereo_seecolor.matching.speckles import remove_speckles
from stereo_seecolor.matching.triangulation import RangeMaps
from stereo_seecolor.plugins import checked, load
from stereo_seecolor.records import Mask, RangeMap, StereoFrame

SPECKLE_PX = 100
"""Connected patches smaller than this are mismatches."""
STRIP = 128
"""Rows that are refined, judged and triangulated together, while they are in the processor's cache.
"""


class Matcher:
    """Computes range maps of rectified pairs; built once for a run, safe to call from many threads.

    Args:
        pair: The geometry of the rectified images.
        config: Settings.
        seen_left: (H, W) bool, True where the rectified left image contains image data; None =
        everywhere.

    Raises:
        ConfigError: If a setting of the engine is missing or wrong.
        DeviceError: If the library of the engine is missing.
        PluginError: If no installed package has this engine.
    """

    def __init__(
        self, pair: RectifiedPair, config: MatchingConfig, seen_left: Mask | None = None
    ) -> None:
        self._pair = pair
        self._config = config
        self.seen_left = seen_left
        self._lowest, self._highest = disparity_limits(pair, config)
        width, height = pair.image_size
        self._scale = 4 if width * height > LARGE_IMAGE_PX else 2
        self._engine = self._chosen_engine()

    def _chosen_engine(self) -> Engine:
        engine = self._config.engine
        if engine == "sgm":
            return SemiGlobalMatching(self._lowest, self._highest)
        if isinstance(engine, Path) or engine == "opencv":
            from stereo_seecolor.matching.network_engine import Network
            from stereo_seecolor.matching.opencv_engine import OpenCvMatching

            if isinstance(engine, Path):
                return Network(engine)
            return OpenCvMatching(self._lowest, self._highest)
        make = load("matching_engines", engine, needs=("__call__",))
        added: Engine = checked(
            make(self._config, self._lowest, self._highest),
            "matching_engines",
            engine,
            needs=("find",),
        )
        return added

    def match(self, frame: StereoFrame) -> RangeMap:
        """Compute the range map of a rectified pair; it depends only on this pair.

        Args:
            frame: The rectified pair, uint8 or uint16 RGB.

        Returns:
            The range map. If the pair cannot be matched, all pixels are unknown, and ``warnings``
            states the reason.
        """
        return self.matched(frame)[0]

    def matched(self, frame: StereoFrame) -> tuple[RangeMap, float]:
        """Compute the range map as ``match`` does, and the detail of the images.

        Args:
            frame: The rectified pair.

        Returns:
            The range map, and the fraction of known pixels over that at reduced size: about 1 for
            sharp images, less if full size only adds noise, 1 if the engine does not match at
            reduced size.
        """
        pair = GrayPair.from_frame(frame, self._scale)
        reason = diagnostics.unusable(pair.small_left, pair.small_right)
        if reason:
            return RangeMap.unknown(
                self._pair.image_size[::-1], f"{reason}: no range is known"
            ), 1.0
        if isinstance(self._config.engine, Path):
            return self.range_map(self._engine.find(frame, pair), pair), 1.0
        repeating = core_pool().submit(
            diagnostics.repeated, pair.small_left, (self._highest - self._lowest) // self._scale
        )
        found = self._engine.find(frame, pair)
        vertical_px = diagnostics.vertical_disparity_px(pair.left, pair.right, found.disparity)
        repeated = repeating.result()
        no_match = repeated | diagnostics.blank(pair.small_left)
        if no_match.any():
            height, width = found.disparity.shape
            found.forget(
                no_match.repeat(self._scale, axis=0).repeat(self._scale, axis=1)[:height, :width]
            )
        range_map = self.range_map(found, pair)
        detail = (
            float(np.isfinite(found.disparity).mean()) / found.reduced_fraction
            if found.reduced_fraction
            else 1.0
        )
        warnings = self._warnings(pair.small_left, range_map, repeated, vertical_px)
        rows_are_off = diagnostics.rows_are_off(vertical_px)
        return (
            replace(
                range_map, vertical_px=vertical_px, rows_are_off=rows_are_off, warnings=warnings
            ),
            detail,
        )

    def _warnings(
        self, small_left: Gray, range_map: RangeMap, repeated: Mask, vertical_px: float
    ) -> tuple[str, ...]:
        every = slice(None, None, self._scale), slice(None, None, self._scale)
        measured = np.where(range_map.filled[every], UNKNOWN, range_map.disparity[every])
        warnings = (
            diagnostics.repetition_warning(repeated),
            diagnostics.one_sided_warning(small_left, measured, repeated, self._scale),
            diagnostics.vertical_disparity_warning(vertical_px),
        )
        return tuple(warning for warning in warnings if warning)

    def range_map(self, found: MatchedDisparity, pair: GrayPair) -> RangeMap:
        """Turn disparities into a range map, in strips of rows on all cores.

        It removes speckles, refines disparities to sub-pixels, estimates the confidence, sets
        pixels below the least confidence to unknown, and triangulates the others.

        Args:
            found: The disparities of an engine; its arrays are changed.
            pair: The gray images of the disparities.

        Returns:
            The range map.
        """
        remove_speckles(found.disparity, SPECKLE_PX)
        if self.seen_left is not None:
            found.forget(~self.seen_left)
        context = Context.of(found, pair.left)
        around = surroundings(context, found.best.shape)
        maps = RangeMaps.empty(found.disparity.shape)
        gain = contrast_gain(pair.left, pair.right)
        least = self._config.min_confidence
        limits_m = self._config.min_range_m, self._config.max_range_m
        height = len(found.disparity)
        strips = [slice(first, min(first + STRIP, height)) for first in range(0, height, STRIP)]

        def judge(rows: slice) -> None:
            disparity, confidence = maps.disparity[rows], maps.confidence[rows]
            support, relief = refine_rows(
                pair, gain, found, rows.start, disparity, maps.range_std_m[rows]
            )
            if self._engine.refined:
                disparity[:] = found.best[rows]
            # log odds until judge_rows
            weigh_rows((found.uniqueness[rows], support, relief, around[rows]), confidence)
            doubt = fattening((found.best, pair.left), context, rows, confidence, least_odds(least))
            judge_rows(least, doubt, disparity, confidence)
            if not self._config.fill:
                maps.measure(self._pair, limits_m, rows)

        list(core_pool().map(judge, strips))
        if not self._engine.refined:
            factor = np.float32(error_factor(pair.left, pair.right, maps.disparity))
            np.multiply(maps.range_std_m, factor, out=maps.range_std_m)
        if self._config.fill:
            whole = fill(maps.disparity)
            self._forget_unseen(whole)
            maps = replace(
                maps, disparity=whole, filled=np.isnan(maps.disparity) & np.isfinite(whole)
            )
            list(core_pool().map(lambda rows: maps.measure(self._pair, limits_m, rows), strips))
        found_ranges = maps.range_map()
        sharpness = diagnostics.right_sharpness(pair.left, pair.right, found_ranges.disparity)
        return replace(found_ranges, right_sharpness=sharpness)

    def _forget_unseen(self, disparity: np.ndarray) -> None:
        if self.seen_left is not None:
            np.copyto(disparity, UNKNOWN, where=~self.seen_left)


def disparity_limits(pair: RectifiedPair, config: MatchingConfig) -> tuple[int, int]:
    """Least and largest disparity of the left image, whole pixels, of points between
    ``config.min_range_m`` and ``max_range_m``.
    """
    # depth, in the corner farthest from the axis
    nearest_m = config.min_range_m / float(pair.ray_length.max())
    limits = pair.disparity_from_depth(np.array([config.max_range_m, nearest_m], dtype=np.float32))
    lowest = int(np.floor(limits[0]))
    return lowest, max(lowest + 1, min(int(np.ceil(limits[1])), pair.image_size[0] - 1))
