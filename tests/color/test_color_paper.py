"""The paper's method on a moment table has the losses, gradients and steps of training on every
pixel.
"""

import os
import time

import cv2
import numpy as np
import paper_pixels as pixels
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from stereo_seecolor.color.corrector import Corrector
from stereo_seecolor.color.fitting import paper
from stereo_seecolor.color.render import torch_apply
from stereo_seecolor.color.sharing.exposure import exposed
from stereo_seecolor.color.table.counting import measure
from stereo_seecolor.color.table.encoding import decoded_bins
from stereo_seecolor.color.table.range_bins import range_edges_m
from stereo_seecolor.compute.threads import limit_cores
from stereo_seecolor.config import ColorConfig, PaperConfig
from stereo_seecolor.records import Water

GAMMA, BETA, RATE = (
    np.array([0.15, 0.25, 0.3]),
    np.array([0.5, 0.3, 0.2]),
    np.array([0.5, 0.15, 0.1]),
)


@pytest.fixture(autouse=True)
def one_thread():
    threads = torch.get_num_threads()
    # the tensors are small, and threads that wait for each other are slow on a busy machine
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(threads)


def random_frame(rng, depth=8):
    """Pixels of which a range bin has one range only, and whose 16-bit values are the bins' own."""
    shape = tuple(rng.integers(2, 30, 2))
    levels = range_edges_m()[rng.integers(60, 180, 12)].astype(np.float32)
    if depth == 8:
        return rng.integers(0, 256, (*shape, 3)).astype(np.uint8), rng.choice(levels, shape)
    return (rng.integers(0, 4096, (*shape, 3)) * 16 + 7).astype(np.uint16), rng.choice(
        levels, shape
    )


def as_tensors(image, range_m, encoding):
    depth = 8 if image.dtype == np.uint8 else 16
    values = decoded_bins(depth, encoding)[image >> (0 if depth == 8 else 4)]
    light = torch.from_numpy(values.reshape(-1, 3).T.copy())[None, :, None]
    return light, torch.from_numpy(range_m.reshape(-1).astype(np.float64))[None, None, None]


def random_raw(rng):
    return torch.from_numpy(rng.uniform(-3, 1, (4, 3, 1)))


@pytest.mark.slow
@given(
    st.integers(0, 2**32 - 1),
    st.sampled_from([8, 16]),
    st.sampled_from(["srgb", "as-is"]),
    st.booleans(),
)
@settings(max_examples=60)
def test_losses_and_gradients_of_a_table_are_those_of_its_pixels(
    seed, depth, encoding, final_sigmoid
):
    rng = np.random.default_rng(seed)
    image, range_m = random_frame(rng, depth)
    veil, dimming = pixels.Backscatter(random_raw(rng)), pixels.Attenuation(random_raw(rng))
    veil.final_sigmoid = final_sigmoid
    light, z = as_tensors(image, range_m, encoding)
    by_pixel = pixels.backscatter_loss(light - veil(z), paper.PENALTY)
    direct = pixels.clamp_direct(light - veil(z)).detach()
    by_pixel_too = pixels.attenuation_loss(direct / dimming(z), direct)
    wanted = (
        torch.autograd.grad(by_pixel, veil.raw)[0],
        torch.autograd.grad(by_pixel_too, dimming.raw)[0],
    )

    sums = paper.Sums(measure(image, range_m), encoding)
    of_veil, of_dimming = (
        network.raw.detach().clone().requires_grad_() for network in (veil, dimming)
    )
    found = paper.backscatter(of_veil, sums.z, final_sigmoid)
    loss = paper.backscatter_loss(sums, found, paper.PENALTY)
    also = paper.attenuation_loss(
        sums, paper.Direct(sums, found.detach()), 1 / paper.attenuation(of_dimming, sums.z)
    )
    assert loss.item() == pytest.approx(by_pixel.item(), rel=1e-9)
    assert also.item() == pytest.approx(by_pixel_too.item(), rel=1e-9, abs=1e-12)
    for gradient, known in zip(
        (torch.autograd.grad(loss, of_veil)[0], torch.autograd.grad(also, of_dimming)[0]),
        wanted,
        strict=True,
    ):
        np.testing.assert_allclose(
            gradient, known, rtol=1e-7, atol=1e-9 * float(known.abs().max()) + 1e-12
        )


@pytest.mark.slow
@pytest.mark.parametrize("final_sigmoid", [False, True])
def test_training_takes_the_path_that_it_takes_on_every_pixel(final_sigmoid):
    """torch.optim.Adam on pixels, our steps on their table: the same weights after a hundred
    steps.
    """
    rng = np.random.default_rng(4)
    image, range_m = random_frame(rng)
    config = PaperConfig(iterations=100, final_sigmoid=final_sigmoid)
    veil = pixels.Backscatter(paper.raw_weights(paper.BACKSCATTER, None))
    dimming = pixels.Attenuation(paper.raw_weights(paper.ATTENUATION, None))
    veil.final_sigmoid = final_sigmoid
    pixels.train(*as_tensors(image, range_m, "srgb"), veil, dimming, config.iterations)
    water = paper.fit(measure(image, range_m), config, "srgb")
    z = torch.linspace(0.5, 9, 30).double()
    for found, known in ((water.backscatter, veil), (water.attenuation, dimming)):
        np.testing.assert_allclose(
            found(z.numpy()), known(z[None, None, None])[0, :, 0].detach().T, rtol=1e-6
        )


def test_all_the_ranges_of_a_bin_as_one_cost_little():
    rng = np.random.default_rng(5)
    image, range_m = (
        rng.integers(0, 256, (60, 80, 3)).astype(np.uint8),
        rng.uniform(1, 6, (60, 80)).astype(np.float32),
    )
    raw, (light, z) = random_raw(rng), as_tensors(image, range_m, "srgb")
    sums = paper.Sums(measure(image, range_m), "srgb")
    table = paper.backscatter_loss(sums, paper.backscatter(raw, sums.z), paper.PENALTY).item()
    assert table == pytest.approx(
        pixels.backscatter_loss(light - pixels.Backscatter(raw)(z), paper.PENALTY).item(), rel=1e-3
    )


def scene(seed, shape=(60, 80), relief=1.0):
    """Linear light through known water; at every range something dark."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[: shape[0], : shape[1]] / np.array(shape)[:, None, None]
    range_m = (
        (2.5 + relief * (3 * y - 1.5 + 1.5 * np.sin(8 * x + seed) ** 2))
        .clip(0.5)
        .astype(np.float32)
    )
    truth = rng.beta(0.8, 2, (*shape, 3)) * rng.uniform(0.5, 1, (*shape, 1))
    z = range_m[..., None]
    light = truth * np.exp(-RATE * z) + GAMMA * (1 - np.exp(-BETA * z))
    return np.clip(light * 255 + 0.5, 0, 255).astype(np.uint8), range_m


def corrector(**changes):
    return Corrector(
        ColorConfig(method="paper", paper=PaperConfig(**changes), input_encoding="as-is")
    )


def losses(table, water, encoding="as-is"):
    sums = paper.Sums(table, encoding)
    veil = torch.from_numpy(water.backscatter(sums.z.numpy()).T.copy())
    gain = torch.from_numpy(1 / water.attenuation(sums.z.numpy()).T)
    return np.array(
        [
            paper.backscatter_loss(sums, veil, paper.PENALTY).item(),
            paper.attenuation_loss(sums, paper.Direct(sums, veil), gain).item(),
        ]
    )


@pytest.mark.slow
def test_backscatter_is_found_where_every_range_has_something_dark():
    image, range_m = scene(0, (200, 300))
    own = corrector()
    water, z = own.fit(own.measure(image, range_m)), np.linspace(1.5, 5, 20)
    assert np.abs(water.backscatter(z) - GAMMA * (1 - np.exp(-BETA * z[:, None]))).max() < 0.02


@pytest.mark.parametrize("final_sigmoid", [False, True])
def test_a_water_of_either_form_is_kept_and_exposed(final_sigmoid):
    own, z = corrector(final_sigmoid=final_sigmoid, iterations=20), np.linspace(0.5, 5, 20)
    water = own.fit(own.measure(*scene(0)))
    again = Water.from_content(water.content())
    assert np.array_equal(again.backscatter(z), water.backscatter(z))
    assert ("final_sigmoid" in water.content()) == final_sigmoid
    np.testing.assert_allclose(exposed(water, 0.5).backscatter(z), 0.5 * water.backscatter(z))
    assert ((water.backscatter(z) > 0) & (water.backscatter(z) < 1)).all()


@pytest.mark.slow
def test_a_picture_can_be_had_after_every_step_and_more_steps_are_better():
    table = corrector().measure(*scene(1))
    with_steps = [losses(table, corrector(iterations=steps).fit(table)) for steps in (1, 30, 500)]
    assert (np.diff(np.sum(with_steps, axis=1)) < 0).all()


@pytest.mark.slow
def test_a_frame_of_the_same_scene_needs_few_steps():
    own = corrector()
    first, table = own.fit_frame(*scene(0)), own.measure(*scene(1))
    warm = losses(table, own.fit(table, first)).sum()
    few_from_cold = losses(table, corrector(iterations=20).fit(table)).sum()
    assert warm < few_from_cold
    assert warm < 1.1 * losses(table, own.fit(table)).sum()


@pytest.mark.slow
def test_only_linked_frames_begin_from_the_frame_before():
    """A folder of unrelated pictures: each water is that of the picture alone."""
    few = PaperConfig(iterations=20, iterations_per_frame=5)
    own = Corrector(ColorConfig(method="paper", lock="frame", paper=few))
    tables = [own.measure(*scene(seed)) for seed in range(3)]
    fitter = own.survey_fitter(linked=["2"])
    for name, table in zip("012", tables, strict=True):
        fitter.add(name, table)
    waters = fitter.waters()
    for name, table in zip("01", tables, strict=False):
        assert np.array_equal(waters[name].w, own.fit(table).w)
    assert np.array_equal(waters["2"].w, own.fit(tables[2], waters["1"]).w)
    assert not np.array_equal(waters["2"].w, own.fit(tables[2]).w)


def test_steps_end_when_the_time_is_up():
    own = corrector(iterations=100_000)
    table, began_s = own.measure(*scene(0)), time.perf_counter()
    one = own.fit(table, until_s=began_s - 1)
    assert np.array_equal(one.w, corrector(iterations=1).fit(table).w)
    own.fit(table, until_s=time.perf_counter() + 0.1)
    assert time.perf_counter() - began_s < 60


@pytest.mark.slow
def test_a_water_of_the_other_form_is_no_start():
    printed, plain = (
        corrector(final_sigmoid=True, iterations_per_frame=5),
        corrector(iterations_per_frame=5),
    )
    table = plain.measure(*scene(0))
    from_other = plain.fit(table, printed.fit(table))
    assert np.array_equal(from_other.w, corrector(iterations=5).fit(table).w)


@pytest.mark.slow
def test_without_relief_the_water_is_the_one_it_began_from():
    own = corrector(iterations=100)
    water = own.fit(own.measure(*scene(0, relief=0.0)))
    assert "no relief" in water.warnings[0]
    survey = own.fit(own.measure(*scene(1)))
    frame = own.fit(own.measure(*scene(0, relief=0.0)), survey)
    assert np.array_equal(frame.w, survey.w)
    assert "another frame's is used" in frame.warnings[0]


@pytest.mark.slow
@pytest.mark.parametrize("method", ["robust", "paper"])
def test_same_result_whatever_the_number_of_threads(method, monkeypatch):
    own = Corrector(ColorConfig(method=method, paper=PaperConfig(iterations=50)))
    image, range_m = scene(3, (150, 200))

    def result(parts):
        limit_cores(parts)
        table = own.measure(image, range_m)
        water = own.fit(table)
        return water, own.apply(image, range_m, water, table)

    monkeypatch.setattr(torch_apply, "PART_PIXELS", 1000)
    try:
        (one_water, one), (many_water, many) = result(1), result(5)
    finally:
        limit_cores(os.cpu_count() or 1)
    assert np.array_equal(one.image, many.image)
    assert np.array_equal(one.unrecoverable, many.unrecoverable)
    assert one.clipped_fraction == many.clipped_fraction
    assert np.array_equal(one_water.w, many_water.w)


# Where the paper cannot be taken as it is printed (docs/theory.md, the same rows).


def backscatter_after_training(loss, steps=250):
    rng = np.random.default_rng(2)
    z = torch.from_numpy(rng.uniform(1, 6, (1, 1, 1, 1000)))
    truth = 0.3 * (1 - torch.exp(-0.4 * z))
    light = truth + torch.from_numpy(rng.exponential(0.1, (1, 3, 1, 1000)))
    network = pixels.Backscatter(paper.raw_weights(paper.BACKSCATTER, None))
    adam = paper.Adam(network.raw, 0.05)
    for _ in range(steps):
        adam.step(loss(light - network(z)))
    with torch.no_grad():
        return (network(z) - truth).abs().max().item(), network(z).max().item()


@pytest.mark.slow
def test_printed_sign_of_the_backscatter_penalty_rewards_negative_direct_signals():
    _, most = backscatter_after_training(
        lambda direct: (direct.clamp(min=0) + 1000 * direct.clamp(max=0)).mean()
    )
    assert most > 0.9  # the backscatter grows to all the light there is, and would beyond
    off, _ = backscatter_after_training(lambda direct: pixels.backscatter_loss(direct, 1000))
    assert off < 0.05


def test_printed_final_sigmoid_keeps_backscatter_above_a_half_unless_weights_may_be_negative():
    z = torch.linspace(0.1, 10, 50).double()
    assert paper.backscatter(torch.full((4, 3, 1), 0.1).double(), z, final_sigmoid=True).min() > 0.5
    negative = paper.raw_weights(paper.BACKSCATTER, None)
    assert paper.backscatter(negative, z, final_sigmoid=True).max() < 0.3


@pytest.mark.slow
def test_a_clamped_rate_never_comes_back_and_ours_does():
    z = torch.linspace(1, 5, 100)
    wanted = torch.exp(-0.5 * z)

    def after_training(start, rate):
        adam = paper.Adam(torch.tensor(start), 0.05)
        for _ in range(800):
            adam.step((torch.exp(-rate(adam.weights) * z) - wanted).square().mean())
        return rate(adam.weights).item()

    assert after_training(-0.5, torch.relu) == 0.0
    assert after_training(-4.0, torch.nn.functional.softplus) == pytest.approx(0.5, abs=0.01)


def test_losses_are_means_so_that_an_image_twice_as_large_trains_alike():
    table = corrector().measure(*scene(0))
    water = corrector(iterations=10).fit(table)
    np.testing.assert_allclose(losses(table, water), losses(table + table, water), rtol=1e-12)


def test_direct_signal_is_clamped_before_attenuation_sees_it():
    flare = np.full((100, 100, 3), 10, np.uint8)
    flare[0, 0] = 250
    sums = paper.Sums(measure(flare, np.full((100, 100), 2.0, np.float32)), "as-is")
    direct = paper.Direct(sums, torch.zeros(3, 1).double())
    assert (direct.ceiling < 0.2).all()
    bright = paper.Direct(sums, torch.full((3, 1), 0.5).double())  # more than there is
    assert (bright.floor >= 0).all()


def test_one_pixel_of_one_color_has_a_loss_and_gradients_that_are_numbers():
    water = corrector(iterations=3).fit(
        measure(np.full((1, 1, 3), 77, np.uint8), np.full((1, 1), 2.0, np.float32))
    )
    assert np.isfinite(
        [getattr(water, name) for name in paper.BACKSCATTER + paper.ATTENUATION]
    ).all()


@pytest.mark.slow
@pytest.mark.real_data
@pytest.mark.parametrize("method", ["robust", "paper"])
def test_real_frames_come_out_whole(real_data, method):
    for path in sorted((real_data / "flsea" / "rgb").iterdir())[:3]:
        image = np.ascontiguousarray(cv2.imread(str(path))[..., ::-1])
        range_m = cv2.imread(
            str(next((real_data / "flsea" / "range").glob(f"*{path.stem}*"))), cv2.IMREAD_UNCHANGED
        )
        own = Corrector(ColorConfig(method=method, paper=PaperConfig(iterations=100)))
        found = own.apply(image, range_m, own.fit_frame(image, range_m))
        assert found.clipped_fraction <= 0.02
        assert np.median(found.image[~found.unknown].max(axis=1)) > 10
