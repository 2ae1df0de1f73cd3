"""The page's paragraph of methods, with the run's own numbers, and the works to cite."""

from typing import Any

import numpy as np

from stereo_seecolor.color.white_point import white_errors
from stereo_seecolor.files.color_spaces import SPACES
from stereo_seecolor.report.facts import DiveFacts
from stereo_seecolor.report.overview import CHANNELS, rugosity_texts
from stereo_seecolor.report.texts import digits, phrase


def methods(facts: DiveFacts) -> str:
    """A paragraph of methods with this run's own numbers; what is unknown is left out."""
    return " ".join([*_methods_of_pairs(facts), *_methods_of_water(facts), *_methods_of_map(facts)])


def _methods_of_pairs(facts: DiveFacts) -> list[str]:
    geometry = facts.run.geometry
    range_m, coverage = facts.typical("median_range_m"), facts.typical("coverage")
    if geometry is None or range_m is None or coverage is None:
        return []
    width, height = geometry.image_size
    refined = [phrase("methods.refine")] if facts.run.config.input.refine else []
    return [
        phrase(
            "methods.pairs",
            ok=facts.count("ok"),
            pairs=len(facts.pairs),
            width=width,
            height=height,
            baseline=digits(1000 * geometry.baseline_m, 4),
            focal=digits(geometry.focal_px, 4),
            version=facts.run.version,
        ),
        phrase(
            "methods.range",
            coverage=f"{coverage:.0%}",
            range=digits(range_m),
            pixel=digits(1000 * range_m / geometry.focal_px),
        ),
        *refined,
    ]


def _methods_of_water(facts: DiveFacts) -> list[str]:
    if not facts.waters:
        return []
    through = np.median(
        [water.attenuation(np.array(1.0)) for water in facts.waters.values()], axis=0
    )
    lock = facts.run.config.color.lock
    shared = phrase(f"methods.lock.{'sliding' if isinstance(lock, int) else lock}")
    sentences = [phrase("methods.water", lock=shared, **_by_channel(through))]
    errors = facts.water.standard_errors.get("y") if facts.water else None
    if errors is not None and np.isfinite(errors).all():
        sentences.append(phrase("methods.water_errors", **_by_channel(errors)))
    if facts.run.config.color.method == "robust":
        sentences += _methods_of_white(facts)
    if facts.typical("light_gain") is not None:
        sentences.append(phrase("methods.light"))
    return [*_methods_of_response(facts), *sentences]


def _methods_of_response(facts: DiveFacts) -> list[str]:
    """How values of the files were read as light; nothing where they were taken as they are."""
    color = facts.run.config.color
    if color.encoding == "as-is":
        return []
    other = color.space != "srgb"
    own_curve = other and color.encoding == "srgb"
    sentences = [] if own_curve else [phrase(f"methods.response.{color.encoding}")]
    if other:
        sentences.append(phrase("methods.space", space=SPACES[color.space].title))
    if any(color.pedestal):
        parts = zip(CHANNELS, color.pedestal, strict=True)
        percent = {channel: f"{100 * value:.1f}" for channel, value in parts}
        sentences.append(phrase("methods.pedestal", **percent))
    return sentences


def _methods_of_white(facts: DiveFacts) -> list[str]:
    """How the white point was found, with its standard errors where they are known."""
    robust = facts.run.config.color.robust
    if robust.fits_white:
        red, blue = white_errors(facts.water) if facts.water else (np.nan, np.nan)
        known = np.isfinite([red, blue]).all()
        said = phrase("methods.white_error", red=f"{red:.0%}", blue=f"{blue:.0%}") if known else ""
        return [phrase(f"methods.white.{robust.white_point}") + said + "."]
    return [
        phrase("methods.white.none" if robust.white_point == "none" else "methods.white.given")
        + "."
    ]


def _by_channel(values: Any) -> dict[str, str]:
    return {
        channel: digits(float(value), 2) for channel, value in zip(CHANNELS, values, strict=True)
    }


def _methods_of_map(facts: DiveFacts) -> list[str]:
    made = facts.map
    if made is None or made.area_m2 is None or facts.track_m is None:
        return []
    numbers = {
        "placed": len(made.track),
        "track": digits(facts.track_m),
        "voxel": digits(1000 * made.cell_m["voxel_m"]),
        "area": digits(made.area_m2),
    }
    residuals = [
        point.position_residual_m for point in made.track if point.position_residual_m is not None
    ]
    track = phrase(f"methods.track.{'given' if residuals else 'own'}")
    sentences = [phrase("methods.map", **numbers), track]
    if made.range_scale != 1:
        sentences.append(phrase("methods.scale", factor=digits(made.range_scale, 4)))
    if facts.structure:
        values = rugosity_texts(facts.structure, lambda meters: f"{digits(1000 * meters)} mm")
        sentences.append(phrase("methods.map_rugosity", **values))
    if residuals:
        sentences.append(phrase("methods.poses", residual=digits(float(np.median(residuals)), 2)))
    return sentences


def citations(facts: DiveFacts) -> list[str]:
    """The works to cite."""
    return [
        phrase("cite.program", version=facts.run.version),
        phrase("cite.deepseecolor"),
        phrase("cite.seathru"),
    ]
