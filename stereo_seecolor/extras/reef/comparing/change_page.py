"""The page of a change between two surveys: index.html beside the files of ``compare``."""

from pathlib import Path

import numpy as np

from stereo_seecolor.extras.reef.comparing.site_change import SiteChange
from stereo_seecolor.files.atomic import write_atomic
from stereo_seecolor.report.templates import render_template

UNSTABLE = 0.2
"""Fraction of the ground that may not fit before the page warns: few reefs change so much."""
BENT = 0.1
"""Fraction of cells outside of patches beyond the level of detection, above which the page warns: 5
% are expected by chance.
"""


def write_change_page(
    folder: Path, change: SiteChange, first: str, second: str, position_note: str = ""
) -> None:
    """Write index.html, which shows change.png and names the other files. first, second: the
    surveys' names.

    Raises OutputError.
    """
    files = sorted(
        path.name for path in folder.iterdir() if path.is_file() and path.suffix != ".html"
    )
    values = {
        "first": first,
        "second": second,
        "change": change,
        "evidence": _evidence(change),
        "files": files,
    }
    reasons = [*_reasons(change), *([position_note] if position_note else [])]
    write_atomic(
        folder / "index.html",
        render_template("change.html.j2", line=_line(change), reasons=reasons, **values),
    )


def _line(change: SiteChange) -> str:
    """The change in one sentence."""
    kinds = [patch.kind for patch in change.patches]
    if not kinds:
        return f"No change was found on {change.overlap_m2:.1f} m² that both surveys show."
    parts = [
        f"{name} of {abs(liters):.2f} ± {std:.2f} l in {_count(kinds.count(kind))}"
        for kind, name, (liters, std) in (
            ("growth", "growth", change.growth_l),
            ("loss", "loss", change.loss_l),
        )
        if kind in kinds
    ]
    colors = sum(kind not in ("growth", "loss") for kind in kinds)
    parts += [f"another color in {_count(colors)}"] if colors else []
    return f"On {change.overlap_m2:.1f} m² that both surveys show: {', '.join(parts)}."


def _count(patches: int) -> str:
    return f"{patches} patch{'' if patches == 1 else 'es'}"


def _reasons(change: SiteChange) -> list[str]:
    """Warnings: reasons to doubt the comparison."""
    found, reasons = change.difference, []
    outside = np.isfinite(found.dz_m) & (change.labels == 0)
    beyond = float((np.abs(found.dz_m) > found.lod_m)[outside].mean()) if outside.any() else 0.0
    if beyond > BENT:
        reasons.append(
            f"{beyond:.0%} of the cells outside all patches lie beyond the level of detection, "
            "where 5 % would: a map may be bent."
        )
    if note := change.registration.scale_note:
        reasons.append(note)
    if change.registration.stable < 1 - UNSTABLE:
        reasons.append(
            f"Only {change.registration.stable:.0%} of the ground fits: much has changed, or a "
            "map is bent."
        )
    return reasons


def _evidence(change: SiteChange) -> list[tuple[str, str]]:
    """(label, numbers) on the quality of the registration and the level of detection."""
    at, std_mm = change.registration, 1000 * np.sqrt(np.diag(change.registration.covariance))
    return [
        (
            "Features that match; of these, in agreement",
            f"{at.matches}, {at.agreeing}, within {1000 * at.feature_rms_m:.1f} mm",
        ),
        ("Ground that fits, and its spread", f"{at.stable:.0%}, {1000 * at.spread_m:.1f} mm"),
        ("Lengths in the first, of those in the second", f"{at.scale:.4f} +- {at.scale_std:.4f}"),
        ("Between features and surfaces", f"{1000 * at.apart_m:.1f} mm"),
        (
            "Standard error of the registration: east, north, up",
            ", ".join(f"{value:.2f}" for value in std_mm[3:]) + " mm",
        ),
        (
            "Standard error of its rotation about east, north, up",
            ", ".join(f"{value:.2f}" for value in std_mm[:3]) + " mrad",
        ),
        (
            "Level of detection, median",
            f"{1000 * float(np.nanmedian(change.difference.lod_m)):.1f} mm",
        ),
        ("Cells beyond it (5 % where nothing changed)", f"{change.beyond_lod:.1%}"),
    ]
