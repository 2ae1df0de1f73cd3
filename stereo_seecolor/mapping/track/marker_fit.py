"""A track constrained by markers of known size, distance or place, and the outcome of each."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from stereo_seecolor.errors import InputError, MappingError
from stereo_seecolor.mapping.control_points import UPSIDE_DOWN, ControlFit, control_fit
from stereo_seecolor.mapping.placed_markers import ScaleCheck, two_of_a_number
from stereo_seecolor.mapping.survey import Placement
from stereo_seecolor.mapping.track.fiducials import PLACES, SETTINGS, Marks
from stereo_seecolor.mapping.track.odometry import Track
from stereo_seecolor.mapping.track.placement_refinement import refined
from stereo_seecolor.mapping.track.pose_graph import Prior
from stereo_seecolor.records import Array, GeoOrigin


@dataclass(frozen=True, eq=False)
class MarkersFit:
    """How a map fits the markers that constrain it.

    scale: factor by which the rig's ranges are taken longer, with its standard error, which grows
    where lengths contradict each other. before, after: what is known against the map without and
    with that, by name. refused: what was not used, since it cannot be right. control: residuals of
    surveyed places.
    origin: of these, where they were given as latitude and longitude. doubled: numbers of which a
    frame shows two markers. unseen: a line for each that is known of markers that were not found.
    """

    markers: int
    scale: float
    scale_std: float
    before: dict[str, ScaleCheck]
    after: dict[str, ScaleCheck]
    refused: tuple[str, ...]
    control: ControlFit | None = None
    origin: GeoOrigin | None = None
    doubled: tuple[int, ...] = ()
    unseen: tuple[str, ...] = ()

    def __str__(self) -> str:
        if not self.before:
            return (
                f"markers: {self.markers} found in two frames or more, but none of a known "
                "size, distance or position: no marker constrains the map"
            )
        text = (
            f"markers: {self.markers} found; ranges multiplied by {self.scale:.5f} ± "
            f"{self.scale_std:.5f}"
        )
        for name, check in self.before.items():
            text += f"; {name} {check.ratio:.5f} ± {check.std:.5f} of the given length"
            text += f", then {self.after[name].ratio:.5f}" if name in self.after else ", not used"
        if self.control:
            text += f"; surveyed positions within {1000 * self.control.rms_m:.1f} mm RMS"
        return text

    @property
    def warnings(self) -> tuple[str, ...]:
        """The disagreements, one line each."""
        warnings = [
            f"{name}: the map has {self.before[name].ratio:.3f} of the given length: not used: "
            f"{self.before[name].cause(self.before.values())}"
            if self.before[name].wrong
            else f"{name}: they contradict the given poses: not used; are they in the "
            "coordinates of the poses?"
            for name in self.refused
        ]
        warnings += self.unseen
        if self.doubled:
            warnings.append(two_of_a_number(self.doubled))
        off, rig = abs(self.scale - 1), SETTINGS.rig_scale_std
        if off > SETTINGS.told_sigmas * rig:
            warnings.append(
                "according to the markers, the rig's ranges must be "
                f"{100 * (self.scale - 1):+.2f} % longer; calibrations rarely have a larger "
                f"error than {100 * rig:.1f} %: calibrate in water, or check the given lengths"
            )
        for name, check in self.after.items():
            std = float(np.hypot(check.std, SETTINGS.given_std))
            if abs(check.ratio - 1) > SETTINGS.told_sigmas * std:
                warnings.append(
                    f"{name}: with all markers the map still has {check.ratio:.5f} of what was "
                    f"given, {abs(check.ratio - 1) / std:.0f} standard errors off"
                )
        return (
            (*warnings, f"surveyed positions: {self.control.doubt}")
            if self.control and self.control.doubt
            else tuple(warnings)
        )


def first_fit(marks: Marks, T_world_camera: Array) -> MarkersFit:
    """The scale by all that can be right: each length by its standard error, and the rig's
    calibration by its own.
    """
    before = marks.checks(T_world_camera)
    refused = tuple(name for name, check in before.items() if check.wrong)
    right = [check for name, check in before.items() if name not in refused]
    values = np.array([1.0, *(1 / check.ratio for check in right)])
    stds = np.array(
        [
            SETTINGS.rig_scale_std,
            *(float(np.hypot(check.std, SETTINGS.given_std)) for check in right),
        ]
    )
    weights = stds**-2
    scale, std = float(weights @ values / weights.sum()), float(weights.sum() ** -0.5)
    # lengths that differ by more than their errors are off by more than these (Birge 1932)
    off = values[1:] - scale
    scatter = float(np.sqrt(weights[1:] @ off**2 / (len(right) - 1))) if len(right) > 1 else 1.0
    found = len(marks.placed(T_world_camera))
    return MarkersFit(
        found,
        scale,
        std * max(scatter, 1.0),
        before,
        {},
        refused,
        doubled=marks.doubled,
        unseen=tuple(
            f"{name}: too few of its markers were found in two frames: not used"
            for name in marks.known
            if name not in before
        ),
    )


def fit_to_fiducials(
    track: Track, placement: Placement, marks: Marks, priors: Sequence[Prior]
) -> tuple[Placement, MarkersFit]:
    """A placement, refined before, fitted to the measured markers in its main component, and the
    outcome of each.

    priors: further constraints of the placement; without them it is moved to the surveyed places as
    a whole first.
    Its lengths are those of a rig of the scale that was found. Raises DeviceError if GTSAM is
    missing.
    """
    fit = first_fit(marks, _main(placement))
    if not fit.before:
        return placement, fit
    used = marks.without(set(fit.refused)).scaled(fit.scale)
    start = _scaled(placement, fit.scale)
    if priors and _far_off(used, start, priors):
        used, fit = used.without({PLACES}), replace(fit, refused=(*fit.refused, PLACES))
    elif not priors:
        start = at_places(used, start)
    better = refined(track.scaled(fit.scale), start, priors, used)
    after = used.checks(_main(better))
    control = _control(used, _main(better)) if PLACES in after else None
    return better, replace(fit, after=after, control=control, origin=used.places.origin)


def _main(placement: Placement) -> Array:
    """(N, 4, 4) poses of the main component, NaN for others."""
    return np.where((placement.components == 0)[:, None, None], placement.T_world_camera, np.nan)


def _scaled(placement: Placement, scale: float) -> Placement:
    """About the middle of its main component."""
    T = placement.T_world_camera.copy()
    middle = T[placement.frames_of(0), :3, 3].mean(axis=0)
    T[:, :3, 3] = middle + scale * (T[:, :3, 3] - middle)
    return replace(placement, T_world_camera=T)


def _far_off(marks: Marks, placement: Placement, priors: Sequence[Prior]) -> bool:
    """Whether surveyed places lie elsewhere than navigation says: in other coordinates."""
    points = marks.places.points
    off_m = [
        float(np.linalg.norm(marker.place_m - points[marker.number]))
        for marker in marks.placed(_main(placement))
        if marker.number in points
    ]
    limit_m = SETTINGS.elsewhere_sigmas * float(np.linalg.norm(priors[0].position_std_m))
    return bool(off_m) and float(np.median(off_m)) > max(limit_m, SETTINGS.elsewhere_m)


def at_places(marks: Marks, placement: Placement) -> Placement:
    """A track brought by one rigid motion to the surveyed places of markers, if three that are not
    in line were found.

    Raises MappingError for places that turn it upside down.
    """
    T = _main(placement)
    fit = _control(marks, T)
    if fit and fit.is_upside_down(marks.placed(T), T):
        raise MappingError(UPSIDE_DOWN)
    return replace(placement, T_world_camera=fit.T @ placement.T_world_camera) if fit else placement


def _control(marks: Marks, T_world_camera: Array) -> ControlFit | None:
    try:
        return control_fit(marks.placed(T_world_camera), marks.places.points, marks.places.stds_m)
    except InputError:
        return None
