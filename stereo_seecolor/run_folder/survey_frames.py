"""The frames of a finished run as a map reads them, one at a time."""

from collections.abc import Sequence

import numpy as np

from stereo_seecolor.compute.sequences import Lazy
from stereo_seecolor.errors import FrameError, InputError
from stereo_seecolor.files.decode import eight_bit
from stereo_seecolor.records import Map, SurveyFrame
from stereo_seecolor.run_folder.finished_run import FinishedFrame, FinishedRun, geometry_of
from stereo_seecolor.run_folder.pair_files import MASK_CODES


class SurveyFrames(Lazy[SurveyFrame]):
    """The current frames of a run, in the dive's order, or those that are given.

    geometry: of the rectified images. T_rectified_left: (4, 4), from the raw left camera's axes.
    range_scale: how many times as long to take their ranges.
    Raises InputError if the run has no calibration, holds no finished frame, or holds frames of two
    settings.
    """

    def __init__(
        self,
        run: FinishedRun,
        range_scale: float = 1.0,
        frames: Sequence[FinishedFrame] | None = None,
    ) -> None:
        geometry, T_rectified_left = geometry_of(run, "a map"), run.T_rectified_left
        assert T_rectified_left is not None
        if run.stale or run.unfinished:
            others = {"of earlier settings": run.stale, "not finished": run.unfinished}
            said = " and ".join(
                f"{len(names)} are {what} ({names[0]})" for what, names in others.items() if names
            )
            raise InputError(
                f"{run.root}: was stopped: {len(run.frames)} frames are finished with the latest "
                f"settings, {said}: run the same command again first"
            )
        if not run.frames or any("corrected" not in frame.products for frame in run.frames):
            fix = "finish the run first"
            if run.totals.get("pairs_of_dive"):
                fix = "it is a shard of a dive: join all shards with stereo-seecolor merge first"
            elif run.totals.get("failed") and not run.totals.get("ok"):
                fix = f"all {run.totals['failed']} pairs failed, for reasons that frames.csv names"
            raise InputError(f"{run.root}: contains no frame that finished all stages: {fix}")
        self.geometry, self.T_rectified_left = geometry, T_rectified_left
        self._frames, self._range_scale = run.frames if frames is None else frames, range_scale

    @property
    def finished(self) -> Sequence[FinishedFrame]:
        """The finished frames, in order."""
        return self._frames

    def __len__(self) -> int:
        return len(self._frames)

    def item(self, number: int) -> SurveyFrame:
        """Read one frame. Raises FrameError if one of its files is gone or damaged."""
        frame = self._frames[number]
        try:
            return self._read(frame).scaled(self._range_scale)
        except InputError as error:
            raise FrameError(frame.name, str(error)) from error

    def _read(self, frame: FinishedFrame) -> SurveyFrame:
        confidence = frame.read("confidence")
        range_m: Map = frame.read("range")
        range_m[confidence == 0] = np.nan
        if "range_std" in frame.products:
            range_std_m: Map = frame.read("range_std")
        else:
            range_std_m = self.geometry.estimated_range_std_m(range_m)
        return SurveyFrame(
            name=frame.name,
            timestamp_s=frame.timestamp_s,
            color=eight_bit(frame.read("corrected")),
            range_m=range_m,
            range_std_m=range_std_m,
            confidence=confidence,
            unrecoverable=frame.read("mask") == MASK_CODES["color not recoverable"],
            right_sharpness=frame.facts.get("right_sharpness", np.nan),
        )
