"""The response of a camera, measured from the noise of its images.

In linear images the variance of the noise is a straight line over brightness, which crosses zero at
the pedestal. In images that are encoded for a screen it is flat or falls. Where denoising or
compression has changed the noise, nothing is decided.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.color.response.jpeg_noise import jpeg_noise_curve
from stereo_seecolor.color.response.laws import DECODERS, LEAST_BINS, Law, fit_law, pedestal_law
from stereo_seecolor.color.response.noise import (
    Blocks,
    NoiseCurve,
    blocks_by_channel,
    noise_curve,
    quantization_of,
)
from stereo_seecolor.color.response.response import Response, as_rgb
from stereo_seecolor.records import Image

SURE = 2.0
"""Least ratio of the misfits of two laws for a decision: on 36 synthetic cameras of each kind
linear images have 2.2 and more, encoded ones at most 1.7 (denoised); real dives 3.0 to 4.2, a
photograph of unknown tone curve 1.4.
"""
CONTRADICTED = 1.3
"""Ratio below which a single channel contradicts the others."""
DEEP_SURE, DEEP_CONTRADICTED = 1.25, 1.0
"""The same for images of 16 bits without a statement on their encoding: most are data of a sensor.
Of 20 synthetic dives (veil, down to 320x256) 15 of linear images have more, and none of images
encoded by sRGB; two of these at half size, and three encoded by a gamma of 1.8.
"""
DEEP_FRAMES = 3
"""Least number of frames for this: the noise of one alone is too uncertain."""
JPEG_LINEAR, JPEG_MISFIT = 2.2, 0.15
"""Least ratio for a doubt, and largest misfit, of JPEGs. Linear frames of a real dive, of quality
90 to 100, have 2.7 to 5.9 and at most 0.08, encoded by sRGB 0.8 to 1.0. But encoded images whose
camera smoothed the dark have up to 6.3, too (synthetic): linear light is never decided.
"""
MOST_MISFIT = 0.35
"""Largest misfit of a law, logarithm, rms."""
MOST_WHITENESS = 3.3
"""Largest whiteness of sensor noise: synthetic sensors 0.9 to 3.1; JPEG of quality 95 3.8."""
BELOW_ZERO = 0.5
"""Fraction of the brightest mean: a line that reaches 0 so far below it is nearly flat."""
FLAT = 0.15
"""The same, if the linear law does not fit better than the encoded one."""
PEDESTAL_BETTER = 1.4
"""Least ratio of the misfit of a line through zero to that with a pedestal, if there is one: 1.6 to
2.3 on synthetic cameras with one and on a real dive, 1.2 at most on those without.
"""
LEAST_PEDESTAL = 3 / 255
"""Least pedestal that is subtracted, fraction of full scale."""


@dataclass(frozen=True)
class MeasuredResponse:
    """The response, and the evidence for it.

    Attributes:
        response: sRGB if undecided.
        verdict: linear, encoded, or undecided.
        ratio: Misfit of the encoded law divided by that of the linear one; NaN without noise, and
            for most undecided ones.
    """

    response: Response
    verdict: Literal["linear", "encoded", "undecided"]
    ratio: float

    @property
    def settings(self) -> dict[str, Any]:
        """Return the settings of ``ColorConfig`` for this response, measured or unknown."""
        unknown = {"input_encoding": "unknown"} if self.verdict == "undecided" else {}
        return self.response.settings | unknown

    @property
    def line(self) -> str:
        """Return one line for the user."""
        if self.verdict == "linear" and np.isnan(self.ratio):
            return "linear light, as the first file states: the noise does not show the encoding"
        if self.verdict == "linear" and self.ratio < SURE:
            return (
                "linear light: 16 bits, and the noise fits linear light better than sRGB, but only "
                f"by a factor of {self.ratio:.1f}; if the files are encoded for a screen, set "
                "color.input_encoding=srgb"
            )
        if self.verdict == "linear":
            return f"linear light: noise grows in proportion to brightness{self._pedestal}"
        if self.verdict == "undecided" and self.ratio > JPEG_LINEAR:
            return (
                "read as sRGB, but the noise that JPEG compression left fits linear light better, "
                f"by a factor of {self.ratio:.1f}: if the camera has no gamma and no noise "
                "reduction, set color.input_encoding=linear"
            )
        if self.verdict == "encoded":
            return f"encoded for a screen, read as sRGB{self._pedestal}"
        return (
            "not measurable, read as sRGB: the noise is too weak or was changed by denoising or "
            "compression; if the files hold linear light, set color.input_encoding=linear"
        )

    @property
    def _pedestal(self) -> str:
        if not any(self.response.pedestal):
            return ""
        values = ", ".join(f"{255 * value:.0f}" for value in self.response.pedestal)
        return f"; pedestal of {values} of 255 (R, G, B) subtracted"


UNDECIDED = MeasuredResponse(Response(), "undecided", np.nan)


def measure_response(
    images: Sequence[Image], stated: Literal["linear", "encoded"] | None = None
) -> MeasuredResponse:
    """Measure the response of one camera.

    Args:
        images: Some frames of it, each (H, W, 3) RGB, uint8 or uint16, raw: not rectified, resized
        or denoised, if possible.
        stated: What their files state. Clear noise contradicts it.

    Returns:
        The response. It is sRGB unless the noise, or else the files, show another.
    """
    deep = stated is None and len(images) >= DEEP_FRAMES and _is_deep(images[0])
    measured = _by_noise(images, deep)
    if measured.verdict != "undecided" or stated is None:
        return measured
    if stated == "linear":
        return MeasuredResponse(Response("linear"), "linear", np.nan)
    return replace(measured, verdict="encoded")


def measure_jpeg(images: Sequence[Image], steps: bytes) -> MeasuredResponse:
    """Measure whether JPEGs are encoded; undecided where they look linear, too, with the ratio.

    steps: of their quantization, as for ``jpeg_noise_curve``.
    """
    curve = jpeg_noise_curve(images, steps)
    if curve is None:
        return UNDECIDED
    linear, encoded = _fitted(curve, np.ones(len(curve.mean), np.bool_))
    ratio = encoded.misfit / max(linear.misfit, 1e-3)
    flat = linear.zero < -FLAT and ratio < CONTRADICTED
    if encoded.misfit < JPEG_MISFIT and (ratio < 1 / CONTRADICTED or flat):
        return MeasuredResponse(Response(), "encoded", ratio)
    if ratio > JPEG_LINEAR and linear.misfit < JPEG_MISFIT:
        return replace(UNDECIDED, ratio=ratio)
    return UNDECIDED


def _is_deep(image: Image) -> bool:
    """Whether an image has more gray values than 8 bits can hold."""
    return bool(image.dtype == np.uint16 and np.unique(image[..., 1]).size > 256)


def _by_noise(images: Sequence[Image], deep: bool) -> MeasuredResponse:
    """The response as the noise shows it. deep: most such images are linear."""
    if not images:
        return UNDECIDED
    channels, rounding = blocks_by_channel(images), quantization_of(images)
    curves = [noise_curve(blocks, rounding) for blocks in channels]
    laws = [_laws(curve) for curve in curves if curve is not None]
    known = [both for both in laws if both is not None]
    if not known:
        return UNDECIDED
    ratios = np.array([encoded.misfit / max(linear.misfit, 1e-3) for linear, encoded in known])
    ratio = float(np.exp(np.log(ratios).mean()))
    misfit = float(np.median([linear.misfit for linear, _ in known]))
    straight = all(linear.zero > -BELOW_ZERO for linear, _ in known)
    sure, contradicted = (DEEP_SURE, DEEP_CONTRADICTED) if deep else (SURE, CONTRADICTED)
    if ratio > sure and ratios.min() > contradicted and misfit < MOST_MISFIT and straight:
        if ratio < SURE:  # the line is too uncertain to show a pedestal
            return MeasuredResponse(Response("linear"), "linear", ratio)
        return MeasuredResponse(_of_frames("linear", channels, rounding), "linear", ratio)
    curved = float(np.median([encoded.misfit for _, encoded in known]))
    flat = not deep and sum(linear.zero < -FLAT for linear, _ in known) > len(known) / 2
    if curved < MOST_MISFIT and (ratio < 1 / CONTRADICTED or (flat and ratio < CONTRADICTED)):
        return MeasuredResponse(_of_frames("srgb", channels, rounding), "encoded", ratio)
    return UNDECIDED


def _laws(curve: NoiseCurve) -> tuple[Law, Law] | None:
    """The law of linear images and the best of encoded ones; None if the curve shows nothing."""
    above = curve.variance > max(1.3 * curve.quantization, 1e-4)
    if above.sum() < LEAST_BINS or curve.whiteness > MOST_WHITENESS:
        return None
    return _fitted(curve, above)


def _fitted(curve: NoiseCurve, bins: NDArray[np.bool_]) -> tuple[Law, Law]:
    """The law of linear images and the best of encoded ones, in some bins."""
    linear = fit_law(curve, bins, "linear")
    return linear, min(fit_law(curve, bins, encoded) for encoded in ("srgb", "gamma"))


def _of_frames(
    encoding: Literal["linear", "srgb"], channels: Sequence[Sequence[Blocks]], quantization: float
) -> Response:
    """The response with the pedestal of each channel: the median of the zeros of the frames' own
    lines, or the zero of the line of all, if frames are too small; at most the darkest value.

    No channel has more than red: a sensor has one pedestal, and white balance raises red most. The
    backscatter of water, which texture can make look like a pedestal, has less red.
    """
    pedestal, better = [], []
    for blocks in channels:
        laws = [law for frame in blocks if (law := pedestal_law([frame], quantization, encoding))]
        if 2 * len(laws) <= len(blocks):
            together = pedestal_law(blocks, quantization, encoding)
            if together is None:
                return Response(encoding)
            laws = [together]
        darkest = np.array([min(frame.darkest for frame in blocks) / 255])
        zero = float(np.median([law.zero for law in laws]))
        pedestal.append(max(min(zero, float(DECODERS[encoding](darkest)[0])), 0.0))
        better.append(np.median([np.log(law.misfit_at_zero / law.misfit) for law in laws]))
    pedestal = [min(one, pedestal[0]) for one in pedestal]
    if max(pedestal) < LEAST_PEDESTAL or np.exp(np.mean(better)) < PEDESTAL_BETTER:
        return Response(encoding)
    return Response(encoding, as_rgb([round(one, 4) for one in pedestal * (3 // len(channels))]))
