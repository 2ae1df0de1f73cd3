"""The losses: what the paper prints and what it must mean; and from a moment table, the same as over every pixel."""

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from stereo_seecolor.color.fitting import losses as per_pixel
from stereo_seecolor.color.fitting.dense import load, train
from stereo_seecolor.color.fitting.model import (
    AttenuationNet,
    BackscatterNet,
    ComplementaryGatedExponentialDecay,
    GatedExponentialDecay,
)
from stereo_seecolor.color.fitting.parameters import ATTENUATION, BACKSCATTER, water_of
from stereo_seecolor.color.fitting.table_losses import Channel, attenuation_loss, backscatter_loss, sums_below
from stereo_seecolor.color.fitting.table_solver import channels, direct_signal
from stereo_seecolor.color.table.bins import range_edges_m
from stereo_seecolor.color.table.encoding import decoded_bins
from stereo_seecolor.color.table.measure import measure
from stereo_seecolor.config import ColorConfig


def random_water(rng):
    shares, rates = rng.uniform(0.01, 0.4, (4, 3)), rng.uniform(0.01, 1.5, (8, 3))
    return water_of(np.stack([shares[0], rates[0], shares[1], rates[1], *rates[2:6]]), "srgb")


def random_frame(rng, depth):
    """Pixels of which a level has one range only, and whose 16-bit values are the bins' own."""
    shape = tuple(rng.integers(2, 30, 2))
    levels = range_edges_m()[rng.integers(60, 180, 12)].astype(np.float32)
    if depth == 8:
        return rng.integers(0, 256, (*shape, 3)).astype(np.uint8), rng.choice(levels, shape)
    return (rng.integers(0, 4096, (*shape, 3)) * 16 + 7).astype(np.uint16), rng.choice(levels, shape)


def as_tensors(image, range_m, encoding):
    depth = 8 if image.dtype == np.uint8 else 16
    values = decoded_bins(depth, encoding)[image >> (0 if depth == 8 else 4)]
    return torch.from_numpy(values.reshape(-1, 3).T.copy())[None, :, None], torch.from_numpy(
        range_m.reshape(-1).astype(np.float64)
    )[None, None, None]


def raw_weights(network, names):
    return np.stack([network.get_submodule(name).weight.detach().numpy().ravel() for name in names])


def raw_gradients(network, names):
    return np.stack([network.get_submodule(name).weight.grad.numpy().ravel() for name in names])


@given(st.integers(0, 2**32 - 1), st.sampled_from([8, 16]), st.sampled_from(["srgb", "as-is"]))
@settings(max_examples=60)
def test_table_losses_and_gradients_are_the_per_pixel_ones(seed, depth, encoding):
    rng = np.random.default_rng(seed)
    image, range_m = random_frame(rng, depth)
    water, config = random_water(rng), ColorConfig(input_encoding=encoding)
    light, z = as_tensors(image, range_m, encoding)
    veil, dimming = BackscatterNet().double(), AttenuationNet().double()
    load(veil, water)
    load(dimming, water)

    dense_b = per_pixel.backscatter_loss(light - veil(z), config.paper.penalty)
    dense_b.backward()
    direct = per_pixel.clamp_direct(light - veil(z)).detach()
    dense_a = per_pixel.attenuation_loss(direct / dimming(z), direct)
    dense_a.backward()

    raw_b, raw_a = raw_weights(veil, BACKSCATTER), raw_weights(dimming, ATTENUATION)
    table_b, table_a, slope_b, slope_a = 0.0, 0.0, [], []
    for c, channel in enumerate(channels(measure(image, range_m), config.input_encoding)):
        slopes = np.empty((channel.z.size, 4))
        table_b += backscatter_loss(raw_b[:, c].copy(), channel, config.paper.penalty, slopes)
        slope_b.append(slopes.sum(axis=0))
        four = np.array([getattr(water, name)[c] for name in BACKSCATTER])
        table_a += attenuation_loss(raw_a[:, c].copy(), channel, direct_signal(channel, four), slopes)
        slope_a.append(slopes.sum(axis=0))
    assert table_b == pytest.approx(dense_b.item(), rel=1e-9)
    assert table_a == pytest.approx(dense_a.item(), rel=1e-9, abs=1e-12)
    for table, dense in ((slope_b, raw_gradients(veil, BACKSCATTER)), (slope_a, raw_gradients(dimming, ATTENUATION))):
        assert np.allclose(table, dense.T, rtol=1e-7, atol=1e-9 * np.abs(dense).max() + 1e-12)


def test_all_the_ranges_of_a_level_as_one_cost_little(reef_like):
    image, range_m = reef_like
    config, water = ColorConfig(), random_water(np.random.default_rng(0))
    light, z = as_tensors(image, range_m, "srgb")
    veil = BackscatterNet().double()
    load(veil, water)
    dense = per_pixel.backscatter_loss(light - veil(z), config.paper.penalty).item()
    raw = raw_weights(veil, BACKSCATTER)
    table = sum(
        backscatter_loss(raw[:, c].copy(), channel, config.paper.penalty, np.empty((channel.z.size, 4)))
        for c, channel in enumerate(channels(measure(image, range_m), config.input_encoding))
    )
    assert table == pytest.approx(dense, rel=1e-3)


@pytest.fixture
def reef_like():
    rng = np.random.default_rng(5)
    return rng.integers(0, 256, (60, 80, 3)).astype(np.uint8), rng.uniform(1, 6, (60, 80)).astype(np.float32)


def test_gated_decay_is_the_paper_s():
    x = torch.tensor([-2.0, 0.0, 0.5, 3.0])
    expected = torch.tensor([1.0, 1.0, np.exp(-0.5), np.exp(-3.0)], dtype=torch.float32)
    assert torch.allclose(GatedExponentialDecay()(x), expected)
    assert torch.allclose(ComplementaryGatedExponentialDecay()(x), 1 - expected)


def test_networks_are_the_model():
    water, z = random_water(np.random.default_rng(1)), np.linspace(0.2, 9, 40).reshape(5, 8)
    veil, dimming = BackscatterNet().double(), AttenuationNet().double()
    load(veil, water)
    load(dimming, water)
    given = torch.from_numpy(z)[None, None]
    assert np.allclose(veil(given)[0].permute(1, 2, 0).detach().numpy(), water.backscatter(z))
    assert np.allclose(dimming(given)[0].permute(1, 2, 0).detach().numpy(), water.attenuation(z))


# COLOR.md, section 2: where the paper cannot be taken as it is printed.


@pytest.fixture(autouse=True)
def one_thread():
    threads = torch.get_num_threads()
    torch.set_num_threads(1)  # the tensors are small, and threads that wait for each other are slow on a busy machine
    yield
    torch.set_num_threads(threads)


def backscatter_after_training(loss, steps=250):
    rng = np.random.default_rng(2)
    z = torch.from_numpy(rng.uniform(1, 6, (1, 1, 1, 1000)))
    truth = 0.3 * (1 - torch.exp(-0.4 * z))
    light = truth + torch.from_numpy(rng.exponential(0.1, (1, 3, 1, 1000)))
    network = BackscatterNet().double()
    load(network, water_of(np.full((8, 3), 0.1), "srgb"))
    train(network, lambda: loss(light - network(z)), steps, 0.05)
    with torch.no_grad():
        return (network(z) - truth).abs().max().item(), network(z).max().item()


@pytest.mark.slow
def test_printed_sign_of_the_backscatter_penalty_rewards_negative_direct_signals():
    def printed(direct):
        return (direct.clamp(min=0) + 1000 * direct.clamp(max=0)).mean()

    _, most = backscatter_after_training(printed)
    assert most > 0.9  # the backscatter grows to all the light there is, and would beyond
    off, _ = backscatter_after_training(lambda direct: per_pixel.backscatter_loss(direct, 1000))
    assert off < 0.05


def test_printed_final_sigmoid_keeps_backscatter_above_a_half():
    water = water_of(np.full((8, 3), 1e-3), "srgb")
    network = BackscatterNet()
    load(network, water)
    z = torch.linspace(0.1, 10, 50)[None, None, None]
    assert torch.sigmoid(network(z)).min() >= 0.5  # of non-negative gamma and eta, as printed
    assert network(z).max() < 0.01


@pytest.mark.slow
def test_a_clamped_rate_never_comes_back_and_ours_does():
    z, wanted = torch.linspace(1, 5, 100), torch.exp(-0.5 * torch.linspace(1, 5, 100))

    def after_training(start, rate):
        weight = torch.nn.Parameter(torch.tensor(start))
        optimizer = torch.optim.Adam([weight], lr=0.05)
        for _ in range(800):
            optimizer.zero_grad()
            (torch.exp(-rate(weight) * z) - wanted).square().mean().backward()
            optimizer.step()
        return rate(weight).item()

    assert after_training(-0.5, torch.relu) == 0.0
    assert after_training(-4.0, torch.nn.functional.softplus) == pytest.approx(0.5, abs=0.01)


def test_losses_are_means_so_that_an_image_twice_as_large_trains_alike():
    rng = np.random.default_rng(3)
    direct = torch.from_numpy(rng.normal(0.2, 0.2, (1, 3, 1, 500)))
    twice = torch.cat([direct, direct], dim=3)
    assert torch.isclose(per_pixel.backscatter_loss(direct, 1000), per_pixel.backscatter_loss(twice, 1000))
    assert torch.isclose(per_pixel.attenuation_loss(direct * 2, direct), per_pixel.attenuation_loss(twice * 2, twice))

    def printed(direct):
        return (direct.clamp(min=0) - 1000 * direct.clamp(max=0)).sum()

    assert printed(twice).item() == pytest.approx(2 * printed(direct).item())


def test_direct_signal_is_clamped_before_attenuation_sees_it():
    direct = torch.full((1, 3, 1, 1000), 0.2).double()
    direct[..., 0], direct[..., 1] = 5.0, -5.0
    clamped = per_pixel.clamp_direct(direct)
    assert clamped.min() >= 0
    assert clamped.max() <= 1
    flare = torch.cat([torch.rand(1, 3, 1, 10_000) * 0.1, torch.full((1, 3, 1, 1), 0.9)], dim=3)
    assert per_pixel.clamp_direct(flare).max() < 0.3


def test_one_pixel_and_no_variation_have_losses_and_gradients_that_are_numbers():
    direct = torch.full((1, 3, 1, 1), 0.3, requires_grad=True)
    loss = per_pixel.attenuation_loss(direct * 2, direct)
    loss.backward()
    assert torch.isfinite(loss)
    assert torch.isfinite(direct.grad).all()
    channel = Channel(np.array([2.0]), np.arange(256) / 255, sums_below(np.eye(1, 256, 77), np.arange(256) / 255), 1 / 3)
    slopes = np.empty((1, 4))
    assert np.isfinite(attenuation_loss(np.zeros(4), channel, direct_signal(channel, np.full(4, 0.1)), slopes))
    assert np.isfinite(slopes).all()
