"""Kernels for one pixel: linear light without the water, its code for display, and the roll-off of highlights."""

from typing import Any

import numpy as np

from stereo_seecolor.color.render.tone import NODES
from stereo_seecolor.color.table.counting import L, U
from stereo_seecolor.compute.compiled import compiled


@compiled
def mixed(light: Any, matrix: Any) -> Any:
    """A pixel's channels after the color matrix, if there is one."""
    r, g, b = light
    if matrix.size == 0:
        return r, g, b
    return (
        matrix[0, 0] * r + matrix[0, 1] * g + matrix[0, 2] * b,
        matrix[1, 0] * r + matrix[1, 1] * g + matrix[1, 2] * b,
        matrix[2, 0] * r + matrix[2, 1] * g + matrix[2, 2] * b,
    )


@compiled
def light_of(values: Any, fine: Any, gains: Any, shown: Any) -> Any:
    """A pixel's linear light. A channel that the camera clipped becomes at least as bright as the unclipped ones, or as the
    brightest if all are clipped.
    """
    one, zero = np.float32(1), np.float32(0)
    r, g, b = unclipped(values, fine, gains, shown.decoded)
    in_r, in_g, in_b = shown.known[values[0]], shown.known[values[1]], shown.known[values[2]]
    if min(in_r, in_g, in_b) < one:
        lost = (one - in_r) * (one - in_g) * (one - in_b)
        gray = (in_r * r + in_g * g + in_b * b + lost * max(r, g, b)) / (in_r + in_g + in_b + lost)
        r += (one - in_r) * max(gray - r, zero)
        g += (one - in_g) * max(gray - g, zero)
        b += (one - in_b) * max(gray - b, zero)
    return r, g, b


@compiled
def unclipped(values: Any, fine: Any, gains: Any, decoded: Any) -> Any:
    """A pixel's linear light. The part that a limited gain leaves out of a channel is taken from the channels with less noise."""
    one = np.float32(1)
    r = gains.gain[0, fine] * decoded[values[0]] - gains.offset[0, fine]
    g = gains.gain[1, fine] * decoded[values[1]] - gains.offset[1, fine]
    b = gains.gain[2, fine] * decoded[values[2]] - gains.offset[2, fine]
    no_r, no_g, no_b = gains.missing[0, fine], gains.missing[1, fine], gains.missing[2, fine]
    if no_r + no_g + no_b > np.float32(0):
        gray = (r + g + b) / ((one - no_r) + (one - no_g) + (one - no_b))  # r, g, b are what the caps left
        r, g, b = r + no_r * gray, g + no_g * gray, b + no_b * gray
    return r, g, b


@compiled
def above_noise(light: Any, noise: Any) -> Any:
    """A channel's light as it is where it stands out of the noise, and the noise's where it does not: with the same for all
    channels, what is lost in noise comes out gray."""
    return np.float32(0.5) * (light + np.sqrt(light * light + np.float32(4) * noise * noise))


@compiled
def code_of(light: Any, curve: Any) -> Any:
    """The code of linear light, between two nodes of the curve."""
    place = min(max(light * np.float32(NODES), np.float32(0)), np.float32(curve.size - 2))
    node = U(np.int32(place))
    return curve[node] + (curve[node + U(1)] - curve[node]) * (place - np.float32(node))


@compiled
def nearest_code(light: Any, curve: Any) -> Any:
    """The code of the nearest node, as in a table for 8 bits: a tenth of their step at most from ``code_of``."""
    place = min(max(light * np.float32(NODES) + np.float32(0.5), np.float32(0)), np.float32(curve.size - 2))
    return curve[L(np.int32(place))]


@compiled
def roll_off(code: Any, knee: Any, length: Any, bend: Any) -> Any:
    """The factor for the codes of a pixel whose greatest code is ``code``: 1 up to the knee, less above (``tone.display``)."""
    over, code = max(code - knee, np.float32(0)), max(code, np.float32(1e-30))
    return (min(code, knee) + over * (length + over * bend) / (length + over)) / code
