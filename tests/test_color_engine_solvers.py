"""The two solvers of the paper's losses: what they find, how they begin, what they cannot know, and that they repeat themselves."""

import os

import numpy as np
import pytest
import torch

from stereo_seecolor.color.corrector import Corrector
from stereo_seecolor.color.fitting import table_solver
from stereo_seecolor.color.fitting.parameters import ATTENUATION, BACKSCATTER, raw_rates
from stereo_seecolor.color.fitting.table_losses import attenuation_loss
from stereo_seecolor.color.render import kernels
from stereo_seecolor.compute.threads import limit_cores
from stereo_seecolor.config import ColorConfig, PaperAdamConfig, PaperConfig
from stereo_seecolor.errors import DeviceError

GAMMA, BETA, RATE = np.array([0.15, 0.25, 0.3]), np.array([0.5, 0.3, 0.2]), np.array([0.5, 0.15, 0.1])


def scene(seed, shape=(60, 80), relief=1.0):
    """Linear light through known water; at every range something dark."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[: shape[0], : shape[1]] / np.array(shape)[:, None, None]
    range_m = (2.5 + relief * (3 * y - 1.5 + 1.5 * np.sin(8 * x + seed) ** 2)).clip(0.5).astype(np.float32)
    truth = rng.beta(0.8, 2, (*shape, 3)) * rng.uniform(0.5, 1, (*shape, 1))
    z = range_m[..., None]
    light = truth * np.exp(-RATE * z) + GAMMA * (1 - np.exp(-BETA * z))
    return np.clip(light * 255 + 0.5, 0, 255).astype(np.uint8), range_m


PENALTY = PaperConfig().penalty


@pytest.fixture
def corrector():
    return Corrector(ColorConfig(method="paper", input_encoding="as-is", device="cpu"))


@pytest.fixture(autouse=True)
def one_thread():
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(threads)


@pytest.mark.slow
def test_backscatter_is_found_where_every_range_has_something_dark(corrector):
    image, range_m = scene(0, (200, 300))
    water, z = corrector.fit(corrector.measure(image, range_m)), np.linspace(1.5, 5, 20)
    assert np.abs(water.backscatter(z) - GAMMA * (1 - np.exp(-BETA * z[:, None]))).max() < 0.02


@pytest.mark.slow
@pytest.mark.parametrize("encoding", ["as-is", "srgb"])
@pytest.mark.parametrize("seed", range(2))
def test_table_solver_ends_no_higher_than_five_hundred_adam_steps_on_every_pixel(seed, encoding):
    corrector = Corrector(ColorConfig(method="paper", input_encoding=encoding, device="cpu"))
    image, range_m = scene(seed, (30, 40))
    table = corrector.measure(image, range_m)
    fast, slow = corrector.fit(table), corrector.fit_dense(image, range_m)
    veil, dimming = table_solver.losses(table, slow, PENALTY)
    assert table_solver.losses(table, fast, PENALTY)[0] <= veil
    # what attenuation can reach depends on the backscatter that is taken away first: compare on Adam's
    same = 0.0
    for c, channel in enumerate(table_solver.channels(table, encoding)):
        direct = table_solver.direct_signal(channel, np.array([getattr(slow, name)[c] for name in BACKSCATTER]))
        found, _ = table_solver.fit_attenuation(channel, direct, None)
        same += attenuation_loss(raw_rates(found), channel, direct, np.empty((channel.z.size, 4)))
    assert same <= dimming


@pytest.mark.slow
def test_adam_goes_down_and_a_warm_start_needs_few_steps():
    config = ColorConfig(method="paper-adam", input_encoding="as-is", device="cpu")
    corrector = Corrector(config)
    frames = [scene(0, (30, 40)), scene(1, (30, 40))]
    table = corrector.measure(*frames[1])
    first = corrector.fit_frame(*frames[0])
    warm = table_solver.losses(table, corrector.fit_frame(*frames[1], start=first), PENALTY)
    few = PaperAdamConfig(first_steps=config.paper_adam.next_steps)
    few_from_cold = Corrector(config.model_copy(update={"paper_adam": few})).fit_frame(*frames[1])
    assert sum(warm) < sum(table_solver.losses(table, few_from_cold, PENALTY))


def test_warm_start_ends_as_low_as_cold(corrector):
    first = corrector.fit(corrector.measure(*scene(0)))
    table = corrector.measure(*scene(1))
    cold, warm = (sum(table_solver.losses(table, corrector.fit(table, start), PENALTY)) for start in (None, first))
    assert warm <= 1.03 * cold


def test_a_start_from_another_world_does_no_harm(corrector):
    image, range_m = scene(0)
    dark = corrector.fit(corrector.measure((image // 50), range_m))
    table = corrector.measure(image, range_m)
    cold, warm = (sum(table_solver.losses(table, corrector.fit(table, start), PENALTY)) for start in (None, dark))
    assert warm <= 1.03 * cold


@pytest.mark.slow
@pytest.mark.parametrize("method", ["robust", "paper"])
def test_same_result_whatever_the_number_of_threads(method, monkeypatch):
    corrector = Corrector(ColorConfig(method=method))
    image, range_m = scene(3, (150, 200))

    def result(parts):
        limit_cores(parts)
        table = corrector.measure(image, range_m)
        water = corrector.fit(table)
        return water, corrector.apply(image, range_m, water, table)

    monkeypatch.setattr(kernels, "PART_PIXELS", 1000)
    try:
        (one_water, one), (many_water, many) = result(1), result(5)
    finally:
        limit_cores(os.cpu_count() or 1)
    assert np.array_equal(one.image, many.image)
    assert np.array_equal(one.unrecoverable, many.unrecoverable)
    assert one.clipped_fraction == many.clipped_fraction
    assert np.array_equal(one_water.w, many_water.w)


def test_standard_errors_are_the_spread_over_scenes():
    corrector = Corrector(ColorConfig(method="paper", paper=PaperConfig(penalty=20), input_encoding="as-is"))
    waters = [corrector.fit(corrector.measure(*scene(seed, (120, 160)))) for seed in range(14)]
    for name in ("gamma_inf", "w", "y"):
        spread = np.std([getattr(water, name) for water in waters], axis=0)
        stated = np.array([water.standard_errors[name] for water in waters])
        known = np.isfinite(stated).any(axis=0)
        ratio = np.nanmedian(stated[:, known], axis=0) / spread[known]
        assert known.any()
        assert (ratio > 0.3).all()
        assert (ratio < 3).all()


def test_without_relief_nothing_is_said_to_be_known(corrector):
    water = corrector.fit(corrector.measure(*scene(0, relief=0.0)))
    assert all(np.isnan(water.standard_errors[name]).all() for name in BACKSCATTER + ATTENUATION)
    assert "no relief" in water.warnings[0]
    survey = corrector.fit(corrector.measure(*scene(1)))
    frame = corrector.fit(corrector.measure(*scene(0, relief=0.0)), survey)
    assert np.array_equal(frame.w, survey.w)
    assert "another frame's is used" in frame.warnings[0]


@pytest.mark.skipif(torch.cuda.is_available(), reason="this machine has a CUDA device")
def test_cuda_asked_for_and_absent_is_named():
    corrector = Corrector(ColorConfig(method="paper-adam", device="cuda"))
    with pytest.raises(DeviceError, match=r"color\.device=cuda: torch finds no CUDA device"):
        corrector.fit_frame(*scene(0))


@pytest.mark.real_data
def test_real_frames_come_out_whole(real_data):
    import cv2

    for path in sorted((real_data / "flsea" / "rgb").iterdir())[:3]:
        image = np.ascontiguousarray(cv2.imread(str(path))[..., ::-1])
        range_m = cv2.imread(str(next((real_data / "flsea" / "range").glob(f"*{path.stem}*"))), cv2.IMREAD_UNCHANGED)
        for method in ("robust", "paper"):
            corrector = Corrector(ColorConfig(method=method))
            found = corrector.apply(image, range_m, corrector.fit_frame(image, range_m))
            assert found.clipped_fraction <= 0.02
            assert np.median(found.image[~found.unknown].max(axis=1)) > 10
