"""The paper's solver: both networks trained by Adam on every pixel, many steps on a first frame, few on those that follow."""

from collections.abc import Callable
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from stereo_seecolor.color.device import find_device
from stereo_seecolor.color.fitting.losses import attenuation_loss, backscatter_loss, clamp_direct
from stereo_seecolor.color.fitting.model import AttenuationNet, BackscatterNet, RangeScale, Scale
from stereo_seecolor.color.fitting.parameters import ATTENUATION, BACKSCATTER, cold_water, raw_fractions, raw_rates, water_of
from stereo_seecolor.color.table.encoding import decoded_values
from stereo_seecolor.config import ColorConfig
from stereo_seecolor.records import Water


def fit(pixels: NDArray[Any], range_m: NDArray[np.float32], config: ColorConfig, start: Water | None = None) -> Water:
    """Fit the water to (N, 3) pixels at (N,) known ranges, meters, by Adam from ``start`` or from COLD.

    Raises DeviceError where CUDA is set and absent.
    """
    device = find_device(config.device)
    adam, encoding = config.paper_adam, config.input_encoding
    steps = adam.first_steps if start is None else adam.next_steps
    depth = 8 if pixels.dtype == np.uint8 else 16
    light = torch.from_numpy(decoded_values(depth, encoding)[pixels.T]).to(device)[None, :, None]  # (1, 3, 1, N)
    z = torch.from_numpy(np.ascontiguousarray(range_m)).to(device)[None, None, None]  # (1, 1, 1, N)
    start = start or cold_water(encoding)

    backscatter = BackscatterNet().to(device)
    load(backscatter, start)
    train(backscatter, lambda: backscatter_loss(light - backscatter(z), adam.penalty), steps, adam.learning_rate)
    with torch.no_grad():
        direct = clamp_direct(light - backscatter(z))

    attenuation = AttenuationNet().to(device)
    load(attenuation, start)
    train(attenuation, lambda: attenuation_loss(direct / attenuation(z), direct), steps, adam.learning_rate)
    return water_of(
        np.stack([_value(backscatter, n) for n in BACKSCATTER] + [_value(attenuation, n) for n in ATTENUATION]), encoding
    )


def train(network: nn.Module, loss: Callable[[], Tensor], steps: int, learning_rate: float) -> None:
    """Train the network's weights by Adam for a number of steps."""
    optimizer = torch.optim.Adam(network.parameters(), lr=learning_rate)
    for _ in range(steps):
        optimizer.zero_grad()
        loss().backward()  # type: ignore[no-untyped-call]
        optimizer.step()


def load(network: nn.Module, water: Water) -> None:
    """Set the network's raw weights to give the water's parameters."""
    with torch.no_grad():
        for name, layer in network.named_children():
            if isinstance(layer, Scale | RangeScale):
                fraction = isinstance(layer, Scale) and layer.fraction
                raw = (raw_fractions if fraction else raw_rates)(getattr(water, name))
                layer.weight.copy_(torch.from_numpy(raw).reshape(3, 1, 1, 1))


def _value(network: nn.Module, name: str) -> NDArray[np.float64]:
    layer = network.get_submodule(name)
    raw = layer.get_parameter("weight").detach().double().cpu().flatten()
    value = torch.sigmoid(raw) if isinstance(layer, Scale) and layer.fraction else nn.functional.softplus(raw)
    return np.asarray(value.numpy())
