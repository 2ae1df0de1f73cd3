"""``check``: test a calibration on image pairs of a dive."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from calibration import CalibrationError, Rectification, StereoRig
from calibration.checks import RowCheck
from calibration.formats import write_rig
from calibration.port import FlatPort
from calibration.port_errors import port_error
from calibration.rectification import raw_points
from calibration.refinement import Refinement
from calibration.suspicions import suspicions
from calibration.verification.conventions import settle_matches
from calibration.verification.matches import Matches, rectified_matches
from calibration.verification.vertical_disparity import LIMITS
from stereo_seecolor.checks.changes import find_change
from stereo_seecolor.checks.dive import IMAGE_CHECKS
from stereo_seecolor.checks.focal_lengths import stated_of_sides
from stereo_seecolor.checks.rig import judge_rig, matches_of, refine_on_dive
from stereo_seecolor.checks.sample import DiveImages, evenly_spaced
from stereo_seecolor.checks.verdict import DiveVerdict, verdict_of
from stereo_seecolor.commands.rig_loading import load_unsettled, pairs_of
from stereo_seecolor.config import InputConfig, RunConfig
from stereo_seecolor.files.free_places import refuse_existing
from stereo_seecolor.inputs.file_form import as_stored, stored_facts

PORT_RANGES = (0.5, 0.75, 1.5, 2.0, 3.0)
"""Ranges at which the error of a flat port is stated, in units of its working range."""


@dataclass(frozen=True)
class RigFacts:
    """Numbers of a rig that a user can compare with the known camera.

    focal_px: of the rectified images. field_deg: their horizontal field of view.
    disparity_at_1_m_px: of a point at depth 1 m.
    port: "flat", "dome" or "none". working_range_m: range at which a flat port's model is exact,
    else None.
    port_error: (range in meters, relative range error that a flat port leaves there).
    states_errors: the calibration states how well it knows focal length and baseline.
    """

    camera_model: str
    image_size: tuple[int, int]
    baseline_m: float
    medium: str
    focal_px: float
    field_deg: float
    disparity_at_1_m_px: float
    port: str = "none"
    working_range_m: float | None = None
    port_error: tuple[tuple[float, float], ...] = ()
    states_errors: bool = False


@dataclass(frozen=True, eq=False)
class CheckResult:
    """A calibration tested on a dive.

    rows: vertical disparity of rectified pairs, and the motion between neighbors. suspicions:
    doubts about the calibration itself. images: what is wrong with the images of the dive. refined:
    what has moved since the calibration; refined_rows: ``rows`` of the refined rig; refined_file:
    that rig; all None unless asked for.
    """

    rig: RigFacts
    rows: RowCheck
    suspicions: tuple[str, ...]
    images: DiveVerdict
    refined: Refinement | None = None
    refined_rows: RowCheck | None = None
    refined_file: Path | None = None

    @property
    def acceptable(self) -> bool:
        """True if rows agree, of the refined rig if there is one, and so does the motion."""
        if self.refined is None:
            return self.rows.acceptable
        return self.refined.after_px <= LIMITS.acceptable_px and not self.is_wrong

    @property
    def is_wrong(self) -> bool:
        """True if numbers that a run makes of this dive would be wrong by more than they state, or
        pairs are left out; with the refined rig where there is one.
        """
        rows = self.refined_rows or self.rows
        return bool(rows.ranges_are_wrong or rows.odd or self.images.wrong)


def check(
    left: Path,
    right: Path,
    calib: str,
    most_pairs: int = 12,
    refine: Path | None = None,
    images: InputConfig | None = None,
) -> CheckResult:
    """Test a calibration on ``most_pairs`` pairs spread evenly over a dive.

    images: how the files are paired and read. refine: a new file for the refined rig, in the native
    format: what has moved since the calibration is estimated from the pairs.
    Raises CalibrationError, InputError, OutputError.
    """
    images = images or InputConfig()
    if refine:
        refuse_existing(refine)
    pairs = pairs_of(left, right, images).pairs
    sample = evenly_spaced(pairs, most_pairs)
    images = as_stored(images, stored_facts(images, sample))
    of_images = verdict_of(IMAGE_CHECKS, DiveImages.with_colors(pairs, RunConfig(input=images)))
    loaded = load_unsettled(calib, pairs, images)
    seen = matches_of(Rectification.from_rig(loaded), sample, images)
    if not seen.matches:
        raise CalibrationError(next(iter(seen.problems.values())))
    raw = [Matches(*raw_points(loaded, one.left, one.right)) for one in seen.matches.values()]
    rig = settle_matches(loaded, raw)
    settled = Rectification.from_rig(rig)
    known = list(zip(seen.matches, rectified_matches(rig, raw), strict=True))
    change = find_change(settled, pairs, images, known)
    unmatched = [
        f"{pair.name}: {problem}: run leaves this pair out"
        for pair, problem in seen.problems.items()
        if pair.name not in change.odd
    ]
    change = replace(change, line="; ".join(filter(None, (change.line, *unmatched))))
    pairs = change.shared(pairs)
    kept = [one for pair, one in zip(seen.matches, raw, strict=True) if pair.name not in change.odd]
    found = rectified_matches(rig, kept)
    judged = judge_rig(rig, found, pairs, images, change)
    if judged.rows is None:
        raise CalibrationError(judged.refusal or judged.too_few)
    if judged.rows.ranges_are_wrong and (stated := stated_of_sides(pairs, rig)):
        of_images = DiveVerdict((stated,)).after(of_images)
    if refine is None:
        rows = judged.with_motion(rig, found, pairs, images).rows
        assert rows
        return CheckResult(rig_facts(rig), rows, suspicions(rig), of_images)
    if judged.refusal:
        raise CalibrationError(f"a wrong calibration is not refined: {judged.refusal}")
    refined = refine_on_dive(rig, kept, pairs, images)
    write_rig(refined, refine)
    found = rectified_matches(refined, kept)
    after = judge_rig(refined, found, pairs, images, change)
    refined_rows = after.with_motion(refined, found, pairs, images).rows
    return CheckResult(
        rig_facts(rig),
        judged.rows,
        suspicions(rig),
        of_images,
        refined.refinement,
        refined_rows,
        refine,
    )


def rig_facts(rig: StereoRig) -> RigFacts:
    """The numbers of a rig."""
    pair = Rectification.from_rig(rig).pair
    width = rig.left.image_size[0]
    return RigFacts(
        camera_model=rig.left.model,
        image_size=rig.left.image_size,
        baseline_m=rig.baseline_m,
        medium=rig.medium,
        focal_px=pair.focal_px,
        field_deg=float(np.degrees(2 * np.arctan(width / 2 / pair.focal_px))),
        disparity_at_1_m_px=pair.focal_px * pair.baseline_m,
        port="none" if rig.port is None else "flat" if isinstance(rig.port, FlatPort) else "dome",
        working_range_m=rig.port.working_range_m if isinstance(rig.port, FlatPort) else None,
        port_error=_port_errors(rig),
        states_errors=rig.errors is not None,
    )


def _port_errors(rig: StereoRig) -> tuple[tuple[float, float], ...]:
    if not isinstance(rig.port, FlatPort):
        return ()
    ranges_m = np.array(PORT_RANGES) * rig.port.working_range_m
    return tuple(
        zip(ranges_m.tolist(), port_error(rig, ranges_m).range_error.tolist(), strict=True)
    )
