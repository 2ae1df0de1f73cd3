"""The response of drawn and of real cameras: linear or encoded, with or without a pedestal."""

import struct
import zlib
from pathlib import Path

import cv2
import numpy as np
import PIL.Image
import PIL.ImageCms
import pytest
from cameras import Camera, drawn_light
from test_color_robust import BLUE, reef, seen_through, slope

from stereo_seecolor.checks.camera_response import settle_response
from stereo_seecolor.color.corrector import Corrector
from stereo_seecolor.color.response.measure import MeasuredResponse, measure_response
from stereo_seecolor.color.response.response import Response, standard_config
from stereo_seecolor.color.table.counting import measure
from stereo_seecolor.config import ColorConfig, InputConfig, RunConfig
from stereo_seecolor.extras.synthetic.render import Scene
from stereo_seecolor.extras.synthetic.survey import SurveySpec
from stereo_seecolor.files.srgb import decode_srgb, encode_srgb
from stereo_seecolor.inputs.images import read_image
from stereo_seecolor.inputs.pairing import Pair, pair_folders
from stereo_seecolor.inputs.stated_encoding import COLOR_SPACE, EXIF_IFD, SRGB, stated_encoding
from stereo_seecolor.pipeline import Pipeline, Stream
from stereo_seecolor.records import Image, StereoFrame, Water

LIGHT = [drawn_light(seed) for seed in range(4)]


def measured(**camera: object) -> MeasuredResponse:
    taken = Camera(**camera)  # type: ignore[arg-type]
    return measure_response([taken.shoot(light, seed) for seed, light in enumerate(LIGHT)])


SENSORS = [
    {},
    {"mosaic": True},
    {"electrons": 2000.0},
    {"electrons": 20000.0, "read": 3.0},
    {"bits": 16},
    {"read": 30.0},
    {"halved": True},
]


@pytest.mark.slow
@pytest.mark.parametrize("sensor", SENSORS)
def test_linear_images_are_told_from_encoded_ones(sensor: dict[str, object]) -> None:
    assert measured(curve="linear", **sensor).verdict == "linear"
    for curve in ("srgb", "gamma 1.8"):
        found = measured(curve=curve, **sensor)
        assert found.verdict != "linear"
        assert found.response == Response()


@pytest.mark.slow
@pytest.mark.parametrize("curve", ["linear", "srgb", "gamma 1.8"])
@pytest.mark.parametrize("change", [{"jpeg": 95}, {"jpeg": 75}, {"denoised": True}])
def test_nothing_wrong_is_decided_of_changed_noise(curve: str, change: dict[str, object]) -> None:
    found = measured(curve=curve, **change)
    assert found.verdict in ("undecided", "linear" if curve == "linear" else "encoded")
    assert found.response.encoding == "srgb" or curve == "linear"


@pytest.mark.slow
@pytest.mark.parametrize("bits", [8, 16])
@pytest.mark.parametrize("curve", ["linear", "srgb"])
def test_a_pedestal_is_found_and_none_where_there_is_none(curve: str, bits: int) -> None:
    found = 255 * np.array(measured(curve=curve, bits=bits, pedestal=15.0).response.pedestal)
    assert (found > 7).all()
    assert (found < 16.5).all()  # a tenth
    assert measured(curve=curve, bits=bits).response.pedestal == (0, 0, 0)


@pytest.mark.slow
def test_the_backscatter_of_green_water_is_not_taken_for_a_pedestal() -> None:
    spec = SurveySpec(
        seed=3,
        pairs=4,
        lines=1,
        image_size=(320, 256),
        altitude_m=(1.8, 2.1),
        tilt_deg=0.0,
        water="coastal-green",
        bottom_depth_m=15.0,
        bits=16,
    )
    scene = Scene.from_spec(spec)
    linear = [scene.photograph(pair).left / 65535.0 for pair in range(spec.pairs)]
    found = measure_response([np.round(255 * image).astype(np.uint8) for image in linear])
    assert found.verdict == "linear"
    assert found.response.pedestal == (0, 0, 0)


@pytest.mark.slow
def test_frames_too_small_for_lines_of_their_own_show_a_pedestal_together() -> None:
    def pedestal(value: float) -> np.ndarray:
        images = [
            Camera(pedestal=value).shoot(drawn_light(seed, (240, 180)), seed) for seed in range(8)
        ]
        return 255 * np.array(measure_response(images).response.pedestal)

    assert (pedestal(15.0) > 7).all()
    assert (pedestal(15.0) < 16.5).all()
    assert (pedestal(0.0) == 0).all()


def test_what_is_undecided_says_so_and_stays_srgb() -> None:
    found = measure_response([np.full((80, 80, 3), 90, np.uint8)])
    assert found.response == Response()
    assert "set color.input_encoding=linear" in found.line
    assert measure_response([]).verdict == "undecided"


@pytest.mark.slow
def test_the_errors_of_an_unmeasured_response_cover_both_readings(tmp_path: Path) -> None:
    pairs = write(tmp_path, [np.full((80, 80, 3), 90, np.uint8)] * 4)
    unmeasured = settle_response(RunConfig(), pairs)[0].color
    assert unmeasured.input_encoding == "unknown"
    rng, range_m = np.random.default_rng(3), slope()
    image = seen_through(BLUE, reef(rng), range_m, rng)

    def fitted(config: ColorConfig) -> Water:
        fitter = Corrector(config).survey_fitter()
        fitter.add("a", measure(image, range_m))
        return fitter.waters()["a"]

    doubted, sure = fitted(standard_config(unmeasured)), fitted(ColorConfig(input_encoding="srgb"))
    np.testing.assert_array_equal(doubted.white, sure.white)
    linear = fitted(ColorConfig(input_encoding="linear"))
    color = np.log(linear.white / sure.white)
    differences = {name: getattr(linear, name) - getattr(sure, name) for name in ("y", "beta")}
    for name, off in (differences | {"white": sure.white * (color - color.mean())}).items():
        assert (np.abs(off) <= 2 * doubted.standard_errors[name]).all()
        assert (doubted.standard_errors[name] > sure.standard_errors[name]).all()


@pytest.mark.parametrize("depth", [8, 16])
@pytest.mark.parametrize("encoding", ["linear", "srgb"])
def test_the_standard_image_holds_the_same_light_without_the_pedestal(
    encoding: str, depth: int
) -> None:
    full, pedestal = 2**depth - 1, np.array([0.08, 0.05, 0.0])
    light = np.random.default_rng(1).uniform(0.02, 0.9, (40, 50, 3))
    seen = light * (1 - pedestal) + pedestal
    value = np.round(full * (encode_srgb(seen) if encoding == "srgb" else seen))
    image = value.astype(np.uint8 if depth == 8 else np.uint16)
    response = Response(encoding, (0.08, 0.05, 0.0))  # type: ignore[arg-type]
    shown = response.standard(image)
    assert shown.dtype == image.dtype
    half = 0.5 / full
    most = half / (1 - 0.08) + half  # rounding of the image and of the result
    assert np.abs(decode_srgb(shown / full) - light).max() < 2.4 * most
    assert (response.standard(np.full((2, 2, 3), full, image.dtype)) == full).all()


def test_the_pedestal_of_a_frame_is_at_most_its_darkest_light() -> None:
    image = np.full((50, 50, 3), 100, np.uint8)
    image[:10] = 12
    found = Response("linear", (0.08, 0.03, 0.0)).of_frame(image)
    assert found.pedestal == pytest.approx((12 / 255, 0.03, 0.0), abs=1e-3)


def write(folder: Path, images: list[np.ndarray]) -> list[Pair]:
    pairs = []
    for number, image in enumerate(images):
        path = folder / f"{number}.png"
        cv2.imwrite(str(path), image[..., ::-1])
        pairs.append(Pair(path.stem, path, path))
    return pairs


@pytest.mark.slow
def test_the_settings_of_a_run_hold_what_was_measured(tmp_path: Path) -> None:
    camera = Camera(pedestal=15.0)
    pairs = write(tmp_path, [camera.shoot(light, seed) for seed, light in enumerate(LIGHT)])
    config, notes = settle_response(RunConfig(), pairs)
    assert config.color.input_encoding == "linear"
    assert min(config.color.pedestal) > 7 / 255
    assert notes[0].startswith("response: linear light") and "pedestal" in notes[0]
    given = RunConfig.model_validate({"color": {"input_encoding": "srgb"}})
    assert settle_response(given, pairs) == (given, ())
    (tmp_path / "damaged.png").write_bytes(b"")
    damaged = Pair("a", tmp_path / "damaged.png", tmp_path / "damaged.png")
    among = [part for pair in pairs for part in (damaged, pair, damaged)]
    assert settle_response(RunConfig(), [damaged] * 9 + among)[0] == config
    assert settle_response(RunConfig(), [damaged]) == (RunConfig(), ())


def png_with(path: Path, kind: bytes, data: bytes) -> None:
    chunk = len(data).to_bytes(4, "big") + kind + data + zlib.crc32(kind + data).to_bytes(4, "big")
    png = cv2.imencode(".png", np.full((60, 80, 3), 90, np.uint8))[1].tobytes()
    path.write_bytes(png[:33] + chunk + png[33:])  # behind the header


def test_srgb_in_a_png_is_a_statement_and_the_gamma_that_imagemagick_writes_is_none(
    tmp_path: Path,
) -> None:
    path = tmp_path / "a.png"
    png_with(path, b"sRGB", b"\0")
    assert stated_encoding(path) == "encoded"
    png_with(path, b"gAMA", (45_455).to_bytes(4, "big"))
    assert stated_encoding(path) is None


def test_a_png_that_states_a_gamma_of_1_is_linear_where_noise_says_nothing(tmp_path: Path) -> None:
    path = tmp_path / "a.png"
    png_with(path, b"gAMA", (100_000).to_bytes(4, "big"))
    config, notes = settle_response(RunConfig(), [Pair("a", path, path)])
    assert config.color.input_encoding == "linear"
    assert notes == (
        "response: linear light, as the first file states: the noise does not show the encoding",
    )


def test_a_photograph_whose_exif_states_srgb_is_encoded(tmp_path: Path) -> None:
    exif = PIL.Image.Exif()
    exif.get_ifd(EXIF_IFD)[COLOR_SPACE] = SRGB
    path = tmp_path / "a.jpg"
    PIL.Image.new("RGB", (80, 60), (90, 90, 90)).save(path, exif=exif)
    assert settle_response(RunConfig(), [Pair("a", path, path)])[1] == ()


def icc_profile(curve: bytes) -> bytes:
    """A profile of one tag, the tone curve of red."""
    table = struct.pack(">I4sII", 1, b"rTRC", 144, len(curve))
    return bytes(36) + b"acsp" + bytes(88) + table + curve


@pytest.mark.parametrize(
    ("curve", "stated"),
    [
        (struct.pack(">4s4xI", b"curv", 0), "linear"),
        (struct.pack(">4s4xIH", b"curv", 1, 256), "linear"),
        (struct.pack(">4s4xIH", b"curv", 1, 563), "encoded"),
        (struct.pack(">4s4xI3H", b"curv", 3, 0, 9000, 65535), "encoded"),
        (struct.pack(">4s4xH2xi", b"para", 0, 1 << 16), "linear"),
        (struct.pack(">4s4xH2x5i", b"para", 3, 157286, 62119, 3417, 5072, 2651), "encoded"),
        (b"curv", None),
    ],
)
def test_a_profile_states_the_encoding(curve: bytes, stated: str | None, tmp_path: Path) -> None:
    path = tmp_path / "a.tif"
    content = icc_profile(curve + bytes(8 if stated else 0))
    PIL.Image.new("RGB", (80, 60), (90, 90, 90)).save(path, icc_profile=content)
    assert stated_encoding(path) == stated


def test_the_profile_of_srgb_and_frames_of_a_video_are_encoded(tmp_path: Path) -> None:
    path = tmp_path / "a.png"
    srgb = PIL.ImageCms.ImageCmsProfile(PIL.ImageCms.createProfile("sRGB")).tobytes()
    PIL.Image.new("RGB", (80, 60), (90, 90, 90)).save(path, icc_profile=srgb)
    assert stated_encoding(path) == "encoded"
    assert stated_encoding(tmp_path / "dive.mp4" / "000012.tif") == "encoded"


@pytest.fixture(scope="module")
def veiled() -> list[Image]:
    """Linear images of 16 bits in turbid water: few different brightnesses."""
    spec = SurveySpec(
        pairs=6, lines=1, image_size=(320, 256), altitude_m=(1.2, 1.4), water="turbid", bits=16
    )
    scene = Scene.from_spec(spec)
    return [scene.photograph(index).left for index in range(spec.pairs)]


@pytest.mark.slow
def test_images_of_16_bits_in_veil_are_linear_if_their_noise_leans_to_it(
    veiled: list[Image],
) -> None:
    found = measure_response(veiled)
    assert found.verdict == "linear"
    assert 1.25 < found.ratio < 2 and "if the files are encoded" in found.line
    encoded = [(65535 * encode_srgb(image / 65535)).astype(np.uint16) for image in veiled]
    assert measure_response(encoded).response == Response()


@pytest.mark.slow
def test_what_files_state_decides_where_noise_does_not(veiled: list[Image]) -> None:
    assert measure_response(veiled, "encoded").verdict == "encoded"
    assert measure_response(veiled, "linear").verdict == "linear"
    shallow = [(image // 257).astype(np.uint8) for image in veiled]
    assert measure_response(shallow).verdict == "undecided"


def test_sides_that_were_saved_in_different_ways_are_named(tmp_path: Path) -> None:
    linear, encoded = (
        write(place, [Camera(curve=curve).shoot(light) for light in LIGHT[:3]])
        for place, curve in ((tmp_path / "l", "linear"), (tmp_path / "r", "srgb"))
        if place.mkdir() is None
    )
    pairs = [Pair(a.name, a.left, b.right) for a, b in zip(linear, encoded, strict=True)]
    notes = settle_response(RunConfig(), pairs)[1]
    assert "the left images are linear and the right ones encoded" in notes[-1]


@pytest.mark.slow
def test_a_stream_measures_its_first_frame() -> None:
    reef = Path("data_samples/reef")
    pair = pair_folders(reef / "left", reef / "right", InputConfig()).pairs[0]
    linear = [
        np.round(65535 * decode_srgb(read_image(path) / 255)).astype(np.uint16)
        for path in (pair.left, pair.right)
    ]
    shown = {}
    for encoding in ("auto", "linear"):
        config = RunConfig.model_validate({"color": {"input_encoding": encoding}})
        pipeline = Pipeline(reef / "cam.yaml", config)
        shown[encoding] = pipeline.process(StereoFrame("1", *linear)).frame.left
    assert pipeline.response.encoding == "linear"
    assert np.array_equal(shown["auto"], shown["linear"])


@pytest.mark.slow
def test_a_stream_of_an_unmeasured_response_states_larger_errors() -> None:
    reef = Path("data_samples/reef")
    pair = pair_folders(reef / "left", reef / "right", InputConfig()).pairs[0]
    smooth = [cv2.medianBlur(read_image(path), 9) for path in (pair.left, pair.right)]
    errors = {}
    for encoding in ("auto", "srgb"):
        config = RunConfig.model_validate({"color": {"input_encoding": encoding}})
        stream = Stream(Pipeline(reef / "cam.yaml", config))
        water = stream.process(StereoFrame("1", *smooth)).correction.water
        errors[encoding] = water.standard_errors["white"]
    assert (errors["auto"] > errors["srgb"]).all()


@pytest.mark.slow
@pytest.mark.real_data
@pytest.mark.parametrize(
    ("files", "encoding"),
    [
        ("acfr/left/*.png", "linear"),
        ("acfr/right/*.png", "linear"),
        ("flsea/rgb/*.tiff", "linear"),
        ("response/*.jpg", "srgb"),
        ("chessboard/left*.jpg", "srgb"),
    ],
)
def test_real_cameras(real_data: Path, files: str, encoding: str) -> None:
    found = sorted(real_data.glob(files))
    images = [read_image(path) for path in found[:: max(len(found) // 6, 1)][:6]]
    assert images
    assert measure_response(images).response.encoding == encoding


def test_the_settings_state_a_response() -> None:
    config = ColorConfig(input_encoding="linear", pedestal=(0.1, 0.0, 0.0))
    response = Response.of(config)
    assert ColorConfig(**response.settings) == config
    assert Response.of(ColorConfig()) == Response()


def test_frames_that_were_balanced_one_by_one_are_named(tmp_path: Path) -> None:
    rng = np.random.default_rng(4)

    def notes(balanced: bool, scenes: int) -> tuple[str, ...]:
        folder = tmp_path / f"{balanced}{scenes}"
        folder.mkdir()
        pairs = []
        for number in range(5):
            scene = np.random.default_rng(number % scenes)
            contrast = scene.uniform(8, 25)
            image = scene.uniform(60, 120, 3) + scene.normal(0, contrast, (64, 80, 3))
            image += rng.normal(0, 1, image.shape)
            if balanced:
                image *= 82.0 / image.mean(axis=(0, 1))
            path = folder / f"{number}.png"
            PIL.Image.fromarray(np.clip(np.round(image), 0, 255).astype(np.uint8)).save(path)
            pairs.append(Pair(str(number), path, path))
        return settle_response(RunConfig(), pairs)[1]

    assert "5 frames of the dive have the same mean of red" in notes(balanced=True, scenes=5)[-1]
    for varied in (notes(balanced=False, scenes=5), notes(balanced=False, scenes=1)):
        assert not any("same mean" in note for note in varied)


@pytest.mark.parametrize("shape", [(1, 1), (1, 40), (9, 9), (19, 25), (20, 9)])
def test_images_of_less_than_a_block_have_no_noise(shape: tuple[int, int]) -> None:
    image = np.random.default_rng(0).integers(1, 250, (*shape, 3), np.uint8)
    assert measure_response([image] * 3).verdict == "undecided"
