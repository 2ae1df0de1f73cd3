"""The color stage as two functions of numpy arrays or torch tensors: ``fit`` and ``correct``."""

import sys
from dataclasses import replace
from typing import Any, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.color.corrector import Corrector
from stereo_seecolor.color.render.tone import choose
from stereo_seecolor.color.response.response import Response, standard_config
from stereo_seecolor.color.response.unshifted import unshifted_warning
from stereo_seecolor.color.table.moment_table import MomentTable
from stereo_seecolor.color.table.range_bins import range_edges_m
from stereo_seecolor.config import ColorConfig
from stereo_seecolor.errors import ColorError
from stereo_seecolor.records import Correction, Water

ArrayLike = TypeVar("ArrayLike")
"""A numpy array or a torch tensor, on any device."""


def fit(
    image: ArrayLike,
    range_m: ArrayLike,
    config: ColorConfig | None = None,
    start: Water | None = None,
) -> Water:
    """Fit the water of an image, or one water to all images of a batch.

    Args:
        image: (H, W, 3) or (N, H, W, 3) RGB, uint8 or uint16.
        range_m: (H, W) or (N, H, W) meters along the ray, unknown where not finite or not above 0.
        config: The method and its settings, with the response of the camera
            (``color.response.measure.measure_response``; auto is taken as sRGB here).
        start: A water to begin from.

    Returns:
        The water.

    Raises:
        ColorError: For other shapes or types, ranges that cannot be meters, and where no pixel has
            a known range.
        DeviceError: For CUDA where there is none.
    """
    corrector, images, ranges = _standard(image, range_m, config)
    if len(images) == 1:
        water = corrector.fit_frame(images[0], ranges[0], start)
    else:
        of_dive = Corrector(corrector.config.of_dive())
        water = of_dive.fit(_table(corrector, images, ranges), start)
    return replace(water, warnings=(*water.warnings, *_doubts(image)))


def correct(
    image: ArrayLike,
    range_m: ArrayLike,
    water: Water | None = None,
    config: ColorConfig | None = None,
) -> Correction:
    """Remove the water from an image, or from each image of a batch.

    Args:
        image: As in ``fit``.
        range_m: As in ``fit``.
        water: From ``fit``; None = fit it now. A batch shares the water and its exposure.
        config: As in ``fit``.

    Returns:
        A Correction of arrays or tensors, on the device of ``image``. Its image, unknown and
            unrecoverable have the first axis of the batch, if there is one; clipped_fraction is the
            mean over the batch.

    Raises:
        ColorError: As in ``fit``, and for water parameters fitted to images read as-is, for
            others, or the reverse.
        DeviceError: As in ``fit``.
    """
    corrector, images, ranges = _standard(image, range_m, config)
    water = water or fit(image, range_m, config)
    exposure, highlights = water.exposure, water.highlights
    if exposure is None:
        exposure, highlights = choose(_table(corrector, images, ranges), water, corrector.config)
    frames = [
        corrector.apply(one, range_of_one, water, exposure=exposure, highlights=highlights)
        for one, range_of_one in zip(images, ranges, strict=True)
    ]
    found = _like(image, frames)
    # those of a water that was fitted to these images are among them
    return replace(found, warnings=tuple(dict.fromkeys((*found.warnings, *_doubts(image)))))


def _doubts(image: Any) -> tuple[str, ...]:
    """What is said of the values of an image or batch that is not empty."""
    images = _array(image)
    if images.dtype != np.uint16:
        return ()
    rows = images.reshape(-1, *images.shape[-2:])  # those of a batch one below the other
    warning = unshifted_warning(rows, int(rows.max()))
    return (warning,) if warning else ()


def _standard(
    image: Any, range_m: Any, config: ColorConfig | None
) -> tuple[Corrector, NDArray[Any], NDArray[Any]]:
    """The corrector, and the frames as it takes them."""
    config = config or ColorConfig()
    response, (images, ranges) = Response.of(config), _frames(image, range_m)
    if not response.is_identity:
        images = np.stack([response.of_frame(one).standard(one) for one in images])
    return Corrector(standard_config(config)), images, ranges


def _frames(image: Any, range_m: Any) -> tuple[NDArray[Any], NDArray[Any]]:
    """(N, H, W, 3) and (N, H, W) numpy arrays, N = 1 for a single frame."""
    images, ranges = _array(image), _array(range_m)
    if (
        images.ndim not in (3, 4)
        or images.shape[-1] != 3
        or images.dtype not in (np.uint8, np.uint16)
    ):
        raise ColorError(
            f"image of shape {images.shape} and type {images.dtype}: needs (H, W, 3) or (N, H, W, "
            "3), uint8 or uint16"
        )
    if ranges.shape != images.shape[:-1]:
        raise ColorError(
            f"range of shape {ranges.shape} for an image of shape {images.shape}: needs "
            f"{images.shape[:-1]}"
        )
    known = ranges[np.isfinite(ranges) & (ranges > 0)]
    middle_m = float(np.median(known)) if known.size else 0.0
    if middle_m > range_edges_m()[-1]:
        raise ColorError(
            f"range of {middle_m:g} (median): needs meters; a range in millimeters is divided by "
            "1000 first"
        )
    return (images, ranges) if images.ndim == 4 else (images[None], ranges[None])


def _table(corrector: Corrector, images: NDArray[Any], ranges: NDArray[Any]) -> MomentTable:
    tables = [
        corrector.measure(image, range_m) for image, range_m in zip(images, ranges, strict=True)
    ]
    return sum(tables[1:], tables[0]) if tables else MomentTable.empty()


def _like(image: Any, frames: list[Correction]) -> Correction:
    """One Correction for all frames, of arrays or tensors, as ``image`` is."""
    if not frames:
        raise ColorError("an empty batch: there is nothing to correct")

    def joined(parts: list[NDArray[Any]]) -> Any:
        whole = np.stack(parts) if image.ndim == 4 else parts[0]
        torch = sys.modules.get("torch") if _is_tensor(image) else None
        return torch.from_numpy(whole).to(image.device) if torch else whole

    maps = {
        name: joined([getattr(frame, name) for frame in frames])
        for name in ("image", "unknown", "unrecoverable")
    }
    clipped = float(np.mean([frame.clipped_fraction for frame in frames]))
    warnings = tuple(dict.fromkeys(warning for frame in frames for warning in frame.warnings))
    return replace(frames[0], **maps, clipped_fraction=clipped, warnings=warnings)


def _array(value: Any) -> NDArray[Any]:
    return np.asarray(value.detach().cpu().numpy() if _is_tensor(value) else value)


def _is_tensor(value: Any) -> bool:
    torch = sys.modules.get("torch")  # a caller with a tensor has imported torch
    return torch is not None and isinstance(value, cast(Any, torch).Tensor)
