"""The files of a change: GeoTIFFs, a table of the patches, a picture, JSON."""

import json
from collections.abc import Iterator
from dataclasses import fields
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.extras.reef.comparing.color_change import ChangedPatch
from stereo_seecolor.extras.reef.comparing.site_change import SiteChange
from stereo_seecolor.files.atomic import write_atomic
from stereo_seecolor.files.csv_tables import csv_text
from stereo_seecolor.mapping.raster import georeference
from stereo_seecolor.mapping.raster.block_raster import BlockRaster
from stereo_seecolor.mapping.raster.georeference import Georeference
from stereo_seecolor.report.templates import filled_in

# The picture of a change: before, after, height and color.

Picture = NDArray[np.uint8]

PANEL_PX = 900
TITLE_PX = 30
LEAST_SCALE_M = 0.02
MOST_DELTA_E = 40.0
RAMP = np.array(
    [(33, 60, 150), (120, 160, 220), (240, 240, 240), (240, 160, 110), (160, 30, 30)], np.float32
)
"""Loss blue, growth red, RGB."""
INK = (20, 20, 20)


def picture(change: SiteChange) -> Picture:
    """Draw the first survey, the second in the first's colors, the change of height with its
    patches, and that of color: (H, W, 3) RGB.
    """
    known = np.isfinite(change.difference.dz_m)
    heights = np.abs(change.difference.dz_m[known])
    scale_m = max(LEAST_SCALE_M, float(np.quantile(heights, 0.995)))
    panels = [
        ("before", _colors(change.before.color, change.before.known)),
        ("after, in the colors of before", _colors(change.color.b_as_a, change.after.known)),
        (
            f"height: blue -{100 * scale_m:.0f} cm, red +{100 * scale_m:.0f} cm",
            _ramp(change.difference.dz_m / scale_m),
        ),
        (
            f"color: white 0, red {MOST_DELTA_E:.0f} CIELAB units",
            _ramp(change.color.delta_e / MOST_DELTA_E),
        ),
    ]
    drawn = [_titled(_sized(image), title) for title, image in panels]
    for number in (2, 3):
        _outline(drawn[number], change, heights_too=number == 2)
    return np.asarray(np.vstack([np.hstack(drawn[:2]), np.hstack(drawn[2:])]))


def _colors(color: NDArray[np.float32], known: NDArray[np.bool_]) -> Picture:
    return np.where(known[..., None], np.nan_to_num(color), 255).clip(0, 255).astype(np.uint8)


def _ramp(values: NDArray[np.floating]) -> Picture:
    """-1 to 1 as RAMP; unknown white."""
    place = (np.clip(np.nan_to_num(values), -1, 1) + 1) * (len(RAMP) - 1) / 2
    image = np.stack(
        [np.interp(place, np.arange(len(RAMP)), RAMP[:, c]) for c in range(3)], axis=-1
    )
    image[~np.isfinite(values)] = 255
    return np.asarray(image.astype(np.uint8))


def _sized(image: Picture) -> Picture:
    factor = PANEL_PX / max(image.shape[:2])
    method = cv2.INTER_AREA if factor < 1 else cv2.INTER_NEAREST
    return np.asarray(cv2.resize(image, None, fx=factor, fy=factor, interpolation=method))


def _titled(image: Picture, title: str) -> Picture:
    framed = cv2.copyMakeBorder(
        image, TITLE_PX, 4, 4, 4, cv2.BORDER_CONSTANT, value=(255, 255, 255)
    )
    cv2.putText(
        framed, title, (8, TITLE_PX - 9), cv2.FONT_HERSHEY_SIMPLEX, 0.6, INK, 1, cv2.LINE_AA
    )
    return np.asarray(framed)


def _outline(image: Picture, change: SiteChange, heights_too: bool) -> None:
    """Draw the patches of a panel, and their numbers, into it."""
    rows, columns = change.before.grid.shape
    factor = PANEL_PX / max(rows, columns)
    for patch in change.patches:
        if (patch.kind in ("growth", "loss")) != heights_too:
            continue
        mask = cv2.resize(
            _mask(change, patch), None, fx=factor, fy=factor, interpolation=cv2.INTER_NEAREST
        )
        contours, _ = cv2.findContours(
            mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE, offset=(4, TITLE_PX)
        )
        cv2.drawContours(image, contours, -1, INK, 1, cv2.LINE_AA)
        corner = max(contours, key=len)[:, 0].max(axis=0)
        cv2.putText(
            image,
            f"{patch.number}",
            tuple(int(v) for v in corner),
            cv2.FONT_HERSHEY_SIMPLEX,
            0.5,
            INK,
            1,
            cv2.LINE_AA,
        )


def _mask(change: SiteChange, patch: ChangedPatch) -> Picture:
    return np.asarray((change.masks[patch.number - 1]).astype(np.uint8))


FORMAT = "stereo-seecolor/change"


def write_change(folder: Path, change: SiteChange, place: Georeference) -> None:
    """Write all files of a change, in the first survey's coordinates; GeoTIFFs where rasterio can
    be imported. Raises OutputError.
    """
    write_atomic(
        folder / "change.png", cv2.imencode(".png", picture(change)[..., ::-1])[1].tobytes()
    )
    write_atomic(
        folder / "change.json", (json.dumps(description(change), indent=2) + "\n").encode()
    )
    names = [field.name for field in fields(ChangedPatch)]
    write_atomic(
        folder / "patches.csv",
        csv_text(names, (vars(patch).values() for patch in change.patches)).encode(),
    )
    if georeference.available():
        for name, bands in _rasters(change):
            _write_raster(folder, name, bands, change, place)


def description(change: SiteChange) -> dict[str, Any]:
    """The numbers of a change; null where one is not known."""
    found, at = change.difference, change.registration
    return {
        "format": FORMAT,
        "registration": {
            "T_first_second": at.T_a_b.tolist(),
            "scale": at.scale,
            "scale_std": at.scale_std,
            "covariance": at.covariance.tolist(),
            "center_m": at.center_m.tolist(),
            "features_alike": at.matches,
            "features_agreeing": at.agreeing,
            "feature_rms_m": at.feature_rms_m,
            "stable_fraction": at.stable,
            "surface_spread_m": at.spread_m,
            "features_to_surfaces_m": at.apart_m,
        },
        "overlap_m2": change.overlap_m2,
        "cell_m": change.before.grid.cell_m,
        "median_lod_m": found.median_lod_m,
        "error_inflation": found.inflation,
        "beyond_lod": change.beyond_lod,
        "growth_l": change.growth_l[0],
        "growth_std_l": change.growth_l[1],
        "loss_l": change.loss_l[0],
        "loss_std_l": change.loss_l[1],
        "patches": len(change.patches),
    }


def _rasters(change: SiteChange) -> Iterator[tuple[str, dict[str, NDArray[Any]]]]:
    found = change.difference
    yield (
        "height_change.tif",
        {
            "change_m": found.dz_m,
            "std_m": found.std_m,
            "level_of_detection_m": found.lod_m,
            "surface_distance_m": change.surface.distance_m,
            "surface_level_of_detection_m": change.surface.lod_m,
            "patch": change.labels,
        },
    )
    color = change.color
    yield (
        "color_change.tif",
        {
            "delta_e": color.delta_e,
            "lightness": color.change[..., 0],
            "chroma": color.change[..., 1],
        },
    )


def _write_raster(
    folder: Path, name: str, bands: dict[str, NDArray[Any]], change: SiteChange, place: Georeference
) -> None:
    scratch = folder / ".scratch" / name
    raster = BlockRaster(scratch, change.before.grid, len(bands), np.float32, np.nan)
    rows, columns = change.before.grid.shape
    raster.write(
        slice(0, rows),
        slice(0, columns),
        np.stack([band.astype(np.float32) for band in bands.values()]),
    )
    georeference.write_geotiff(folder / name, raster, place, tuple(bands))


# The page of a change between two surveys: index.html beside the files of ``compare``.

UNSTABLE = 0.2
"""Fraction of the ground that may not fit before the page warns: few reefs change so much."""
BENT = 0.1
"""Fraction of cells outside of patches beyond the level of detection, above which the page warns: 5
% are expected by chance.
"""


def write_change_page(folder: Path, change: SiteChange, first: str, second: str) -> None:
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
    write_atomic(
        folder / "index.html",
        filled_in("change.html.j2", line=_line(change), reasons=_reasons(change), **values),
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
            "Features that look alike, and agree on one place",
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
            "The same of its turn about east, north, up",
            ", ".join(f"{value:.2f}" for value in std_mm[:3]) + " mrad",
        ),
        (
            "Level of detection, median",
            f"{1000 * float(np.nanmedian(change.difference.lod_m)):.1f} mm",
        ),
        ("Cells beyond it (5 % where nothing changed)", f"{change.beyond_lod:.1%}"),
    ]
