"""The stages of a frame in torch against the compiled ones, on torch's CPU device: what a GPU runs,
but for its kernels.
"""

import importlib.util
import os
import subprocess
import sys
from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from calibration.errors import CalibrationError
from calibration.formats import load_rig
from stereo_seecolor import device
from stereo_seecolor import pipeline as pipeline_module
from stereo_seecolor.color.corrector import Corrector
from stereo_seecolor.config import ColorConfig, MatchingConfig, RunConfig
from stereo_seecolor.config.file import load_config
from stereo_seecolor.device import color, sgm
from stereo_seecolor.device.color import DeviceCorrector
from stereo_seecolor.device.matching import DeviceMatcher
from stereo_seecolor.device.memory import Memory
from stereo_seecolor.device.rectify import Rectifier, remap
from stereo_seecolor.device.surroundings import refine
from stereo_seecolor.dive.frames import color_settings
from stereo_seecolor.errors import DeviceError
from stereo_seecolor.inputs.images import read_image
from stereo_seecolor.matching.matcher import Matcher
from stereo_seecolor.matching.sgm import search as compiled
from stereo_seecolor.matching.sgm.band import LANES, TILE, Band
from stereo_seecolor.pipeline import Pipeline, correct, ranges_for_color
from stereo_seecolor.records import StereoFrame

REEF = Path(__file__).parents[2] / "data_samples/reef"
CPU = torch.device("cpu")


@pytest.fixture(autouse=True, scope="module")
def one_thread():
    usual = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(usual)


def texture(
    seed: int, size: tuple[int, int], shift: int, noise: float
) -> tuple[np.ndarray, np.ndarray]:
    """A random gray image and the same ``shift`` pixels to the left, with noise."""
    rng = np.random.default_rng(seed)
    wide = cv2.GaussianBlur(
        rng.uniform(0, 65535, (size[0], size[1] + abs(shift))).astype(np.float32), (0, 0), 1.0
    )
    left, right = (
        wide[:, first : first + size[1]] for first in ((0, shift) if shift >= 0 else (-shift, 0))
    )
    return tuple(
        np.clip(image + rng.normal(0, noise, image.shape), 0, 65535).astype(np.uint16)
        for image in (left, right)
    )


def on(device_type: str, image: np.ndarray) -> torch.Tensor:
    return torch.from_numpy(image.astype(np.float32)).to(device_type)


@pytest.mark.slow
@given(
    seed=st.integers(0, 2**32 - 1),
    size=st.tuples(st.integers(4, 150), st.integers(4, 60)),
    shift=st.integers(-6, 20),
    noise=st.sampled_from([0.0, 300.0, 5000.0]),
)
@settings(max_examples=15, deadline=None)
def test_the_search_in_random_bands_is_equal_to_the_bit(seed, size, shift, noise):
    rng, tiles = np.random.default_rng(seed), tuple(-(-side // TILE) for side in size)
    lowest = (shift + rng.integers(-20, 3, tiles)).astype(np.int32)
    band = Band(lowest, (LANES * rng.integers(1, 4, tiles)).astype(np.int32))
    left, right = texture(seed, size, shift, noise)
    wanted, found = (
        compiled.search(left, right, band),
        sgm.search(on("cpu", left), on("cpu", right), band),
    )
    for name, values in found._asdict().items():
        np.testing.assert_array_equal(values.numpy(), getattr(wanted, name), err_msg=name)


@pytest.mark.slow
def test_groups_of_strips_give_what_all_at_once_give(monkeypatch):
    left, right = texture(1, (300, 40), 5, 300.0)
    band = Band.everywhere(left.shape, -2, 13)
    whole = sgm.search(on("cpu", left), on("cpu", right), band)
    monkeypatch.setitem(sgm.VOLUME_BYTES, "cpu", 1)
    for one, other in zip(whole, sgm.search(on("cpu", left), on("cpu", right), band), strict=True):
        np.testing.assert_array_equal(one.numpy(), other.numpy())


def paths(device_type: str, steps=sgm.along) -> torch.Tensor:
    """The sums of random costs in random bands."""
    rng = np.random.default_rng(0)
    shape = (2, 7, 3, 16)
    cost = rng.integers(0, 23, shape).astype(np.uint8)
    cost[..., :5] = np.where(rng.random((*shape[:3], 5)) < 0.6, compiled.FAR, cost[..., :5])
    p2 = rng.integers(6, 100, (2, 8, 3)).astype(np.uint8)
    total = torch.zeros(shape, dtype=torch.int16, device=device_type)
    steps(
        torch.from_numpy(cost).to(device_type),
        torch.from_numpy(p2).to(device_type),
        total,
        slice(1, 6),
    )
    return total


TRITON = importlib.util.find_spec("triton") is not None


@pytest.mark.skipif(
    not TRITON,
    reason="Triton is not installed: pip install triton, which the CUDA builds of torch bring",
)
@pytest.mark.slow
def test_triton_kernels_sum_the_same_costs():
    """In a process of its own: the interpreter is chosen when the kernels are imported."""
    code = """
        import numpy, test_device
        from stereo_seecolor.device.triton_paths import along
        numpy.testing.assert_array_equal(test_device.paths("cpu", along).numpy(), test_device.paths("cpu").numpy())
    """  # noqa: E501
    code = "\n".join(line.strip() for line in code.splitlines())
    search_path = os.pathsep.join([str(Path(__file__).parent), *filter(None, sys.path)])
    environment = {**os.environ, "TRITON_INTERPRET": "1", "PYTHONPATH": search_path}
    subprocess.run([sys.executable, "-c", code], check=True, env=environment, timeout=200)


@pytest.mark.skipif(
    not TRITON,
    reason="Triton is not installed: pip install triton, which the CUDA builds of torch bring",
)
@pytest.mark.slow
@pytest.mark.parametrize("capability", [87, 90])
def test_triton_kernels_compile_for_a_jetson_orin_and_an_h100(capability, monkeypatch):
    monkeypatch.setenv("TRITON_DEFAULT_FP_FUSION", "1")  # Triton 3.9 warns without it
    from triton import compile as built
    from triton.backends.compiler import GPUTarget
    from triton.compiler import ASTSource

    from stereo_seecolor.device.triton_paths import _path

    kinds = {
        "cost": "*u8",
        "p2": "*u8",
        "total": "*i16",
        "forward": "constexpr",
        "block": "constexpr",
    }
    types = {name: kinds.get(name, "i32") for name in _path.arg_names}
    source = ASTSource(fn=_path, signature=types, constexprs={"forward": True, "block": 128})
    assert built(source, target=GPUTarget("cuda", capability, 32)).asm["cubin"]


@pytest.mark.slow
def test_the_shapes_of_the_paths_fit_on_the_meta_device():
    assert paths("meta").shape == (2, 7, 3, 16)


@lru_cache
def reef(number: int = 2) -> tuple[Pipeline, StereoFrame]:
    """The pipeline of the sample dive and a rectified pair of it."""
    pipeline = Pipeline(load_rig(str(REEF / "cam.yaml")), RunConfig())
    left, right = (sorted((REEF / side).iterdir())[number] for side in ("left", "right"))
    return pipeline, pipeline.rectify(
        StereoFrame(left.name, *(read_image(path, pipeline.config.input) for path in (left, right)))
    )


@pytest.mark.slow
def test_ranges_are_those_of_the_compiled_matcher():
    pipeline, frame = reef()
    geometry = pipeline.rectification.matching_pair
    wanted = Matcher(geometry, MatchingConfig()).match(frame)
    found = DeviceMatcher(Memory(CPU), geometry, MatchingConfig()).match(frame)
    known, also = np.isfinite(wanted.disparity), np.isfinite(found.disparity)
    assert (known != also).mean() < 1e-4
    off_px = np.abs(wanted.disparity - found.disparity)[known & also]
    assert off_px.max() < 0.1
    assert np.quantile(off_px, 0.999) < 0.01
    assert np.nanmax(np.abs(wanted.range_std_m / found.range_std_m - 1)) < 0.05
    assert np.abs(wanted.confidence - found.confidence)[known & also].max() < 0.05
    assert found.warnings == wanted.warnings
    assert found.vertical_px == pytest.approx(wanted.vertical_px, abs=1e-6)
    assert found.right_sharpness == pytest.approx(wanted.right_sharpness, abs=1e-3)


@pytest.mark.slow
def test_standard_errors_of_denoised_images_are_those_of_the_compiled_matcher():
    pipeline, frame = reef()
    smooth = (
        cv2.fastNlMeansDenoisingColored(image, None, 8, 8, 5, 15)
        for image in (frame.left, frame.right)
    )
    frame, geometry = StereoFrame("smooth", *smooth), pipeline.rectification.matching_pair
    wanted, found = (
        matcher.match(frame).range_std_m
        for matcher in (
            Matcher(geometry, MatchingConfig()),
            DeviceMatcher(Memory(CPU), geometry, MatchingConfig()),
        )
    )
    assert abs(np.nanmedian(wanted / found) - 1) < 0.01


@pytest.mark.slow
def test_holes_are_closed_and_black_pairs_named_as_by_the_compiled_matcher():
    pipeline, frame = reef()
    geometry, config = pipeline.rectification.matching_pair, MatchingConfig(fill=True)
    part = StereoFrame(
        "part",
        *(
            np.where(np.arange(576)[:, None] < 60, 0, image).astype(np.uint8)
            for image in (frame.left, frame.right)
        ),
    )
    wanted, found = (
        matcher.match(part)
        for matcher in (Matcher(geometry, config), DeviceMatcher(Memory(CPU), geometry, config))
    )
    assert (wanted.filled != found.filled).mean() < 1e-3
    off_px = np.abs(wanted.disparity - found.disparity)
    measured, filled = (
        np.isfinite(off_px) & (wanted.filled == kind) & (found.filled == kind)
        for kind in (False, True)
    )
    # where rounding decides between two neighbors that are 1 px apart
    assert (off_px[measured] > 0.1).mean() < 5e-4
    assert filled.sum() > 10_000
    assert (off_px[filled] > 0.1).mean() < 0.03
    black = StereoFrame("black", np.zeros_like(frame.left), frame.right)
    assert (
        DeviceMatcher(Memory(CPU), geometry, config).match(black).warnings
        == Matcher(geometry, config).match(black).warnings
    )


def test_the_memory_of_a_device_keeps_what_it_gave_out():
    memory = Memory(CPU)
    tensor = torch.arange(6.0)
    array = memory.array(tensor)
    assert memory.tensor(array) is tensor
    del array
    assert not memory._held


@pytest.mark.skipif(torch.cuda.is_available(), reason="there is a CUDA device here")
def test_without_a_gpu_auto_takes_the_compiled_loops_and_cuda_is_refused(monkeypatch):
    assert device.memory_of("cpu") is None
    assert device.memory_of("auto") is None
    monkeypatch.setattr(device, "DRIVERS", (sys.executable,))
    assert device.memory_of("auto") is None
    with pytest.raises(DeviceError, match="finds no CUDA device"):
        device.memory_of("cuda")
    assert type(reef()[0].matcher._full) is Matcher


@pytest.fixture
def torch_stages(monkeypatch):
    """Pipelines whose stages run in torch on its CPU device."""
    monkeypatch.setattr(
        device, "memory_of", lambda name: None if name == "cpu" else device.memory_on("cpu")
    )
    monkeypatch.setattr(pipeline_module, "memory_of", device.memory_of)


@pytest.mark.parametrize("depth", [np.uint8, np.uint16])
def test_rectified_images_are_those_of_opencv(depth):
    rectification = reef()[0].rectification
    width, height = rectification.raw_size
    image = (
        np.random.default_rng(0).integers(0, np.iinfo(depth).max, (height, width, 3)).astype(depth)
    )
    found = Rectifier(Memory(CPU), rectification).apply_right(image)
    off = np.abs(found.astype(int) - rectification.apply_right(image).astype(int))
    assert found.dtype == depth
    assert off.max() <= (0 if depth is np.uint8 else 1)
    with pytest.raises(CalibrationError):
        Rectifier(Memory(CPU), rectification).apply_left(image[:-1])


@pytest.mark.slow
def test_a_frame_through_all_stages_is_that_of_the_compiled_pipeline(torch_stages):
    rig = load_rig(str(REEF / "cam.yaml"))
    in_torch, compiled_stages = (Pipeline(rig), Pipeline(rig, load_config(None, ["device=cpu"])))
    assert isinstance(in_torch.matcher._full, DeviceMatcher)
    assert isinstance(in_torch.corrector, DeviceCorrector)
    assert type(compiled_stages.corrector) is Corrector
    left, right = (sorted((REEF / side).iterdir())[2] for side in ("left", "right"))
    frame = StereoFrame(
        left.name, *(read_image(path, in_torch.config.input) for path in (left, right))
    )
    found, wanted = in_torch.process(frame), compiled_stages.process(frame)
    np.testing.assert_array_equal(found.frame.left, wanted.frame.left)
    off = np.abs(found.correction.image.astype(int) - wanted.correction.image.astype(int))
    assert (off > 1).mean() < 1e-4
    assert (found.correction.unknown == wanted.correction.unknown).all()
    assert found.correction.exposure == pytest.approx(wanted.correction.exposure, rel=1e-4)
    assert found.warnings == wanted.warnings


@pytest.mark.slow
@pytest.mark.parametrize("depth", [8, 16])
@pytest.mark.parametrize("unknown_pixels", ["interpolate", "raw"])
def test_colors_are_those_of_the_compiled_corrector(depth, unknown_pixels):
    pipeline, frame = reef()
    image = frame.left if depth == 8 else frame.left.astype(np.uint16) * 257
    range_map = Matcher(pipeline.rectification.matching_pair, MatchingConfig()).match(frame)
    range_m = range_map.range_m.copy()
    range_m[100:180, 200:290] = np.nan  # wide enough for its colors to be limited
    range_map = range_map.with_ranges(range_m, range_map.filled)
    config = RunConfig(color=ColorConfig(unknown_pixels=unknown_pixels))
    wanted, found = Corrector(config.color), DeviceCorrector(Memory(CPU), config.color)
    table, also = wanted.measure(image, range_m), found.measure(image, range_m)
    np.testing.assert_array_equal(table.counts, also.counts)
    np.testing.assert_array_equal(table.offset_sum, also.offset_sum)
    water = wanted.fit(table)
    ranges = [ranges_for_color(corrector, image, range_map, water) for corrector in (wanted, found)]
    np.testing.assert_allclose(ranges[1].range_m, ranges[0].range_m, rtol=1e-5)
    shown = [
        correct(corrector, config, image, of, water)
        for corrector, of in zip((wanted, found), ranges, strict=True)
    ]
    off = np.abs(shown[0].image.astype(int) - shown[1].image.astype(int))
    assert off.max() <= (1 if depth == 8 else 257)
    assert (shown[0].unknown == shown[1].unknown).all()
    assert (shown[0].unrecoverable != shown[1].unrecoverable).mean() < 1e-5


def test_the_shapes_of_the_color_stages_fit_on_the_meta_device():
    """What has shapes that do not follow the values: the smoother, the limits of colors, and
    rectification.
    """
    image, carried = (
        torch.zeros((60, 90, 3), dtype=torch.uint8, device="meta"),
        torch.zeros((60, 90), dtype=torch.bool, device="meta"),
    )
    limit = torch.ones(3, device="meta")
    assert color.within(image, carried, limit, limit).shape == (60, 90, 3)
    smoothed = color.smooth(
        image.permute(2, 0, 1).float(), torch.zeros((2, 60, 90), device="meta"), 10.0, 5.0, 2
    )
    assert smoothed.shape == (2, 60, 90)
    places = torch.zeros((4, 40, 50), dtype=torch.int64, device="meta")
    assert remap(image[None].expand(3, -1, -1, -1), places, places.int()).shape == (3, 40, 50, 3)
    gray = torch.zeros((60, 90), device="meta")
    assert refine(gray, gray, gray, gray).disparity.shape == (60, 90)


def test_another_device_is_no_reason_to_measure_or_correct_again() -> None:
    rig, settings_of = load_rig(REEF / "cam.yaml"), {}
    for name in ("auto", "cpu"):
        config = load_config(None, [f"device={name}"])
        settings_of[name] = Pipeline(rig, config).settings, color_settings(config, None)
    assert settings_of["auto"] == settings_of["cpu"]
