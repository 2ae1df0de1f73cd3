"""Images of other color spaces than sRGB, as cameras and raw converters save them."""

import re
import struct
from pathlib import Path

import cv2
import numpy as np
import PIL.Image
import PIL.ImageCms
import pytest

from stereo_seecolor.checks.camera_response import settle_response
from stereo_seecolor.color.response.response import Response
from stereo_seecolor.commands.run import run
from stereo_seecolor.config import RunConfig
from stereo_seecolor.dive.run_options import RunOptions
from stereo_seecolor.files.color_spaces import SPACES, SpaceName, primaries, space_of, to_srgb
from stereo_seecolor.files.srgb import decode_srgb, encode_srgb
from stereo_seecolor.inputs.pairing import Pair
from stereo_seecolor.inputs.stated_encoding import EXIF_IFD, INTEROPERABILITY_IFD, stated_encoding
from stereo_seecolor.records import Image

REEF = Path(__file__).parents[2] / "data_samples" / "reef"
OTHERS: tuple[SpaceName, ...] = ("adobe-rgb", "display-p3", "prophoto")


def icc_profile(columns: np.ndarray, gamma: float = 2.2, name: bytes = b"drawn") -> bytes:
    """A profile of version 2 with primaries (XYZ, D50, in columns) and one curve."""

    def xyz(value: np.ndarray) -> bytes:
        return b"XYZ " + bytes(4) + struct.pack(">3i", *np.round(65536 * value).astype(int))

    curve = b"curv" + bytes(4) + struct.pack(">IHH", 1, round(256 * gamma), 0)
    text = b"desc" + bytes(4) + struct.pack(">I", len(name) + 1) + name + bytes(1 + 78)
    tags = {
        b"desc": text + bytes(-len(text) % 4),
        b"cprt": b"text" + bytes(4) + b"none" + bytes(4),
        b"wtpt": xyz(np.array([0.9642, 1.0, 0.8249])),
        **{key: xyz(columns[:, at]) for at, key in enumerate((b"rXYZ", b"gXYZ", b"bXYZ"))},
        **dict.fromkeys((b"rTRC", b"gTRC", b"bTRC"), curve),
    }
    place, table, data = 128 + 4 + 12 * len(tags), b"", b""
    for key, content in tags.items():
        table += struct.pack(">4sII", key, place + len(data), len(content))
        data += content
    head = struct.pack(
        ">I4sI4s4s4s12x4s",
        place + len(data),
        bytes(4),
        0x02100000,
        b"mntr",
        b"RGB ",
        b"XYZ ",
        b"acsp",
    )
    white = struct.pack(">3i", 0xF6D6, 0x10000, 0xD32D)
    head = head.ljust(68, b"\0") + white
    return head.ljust(128, b"\0") + struct.pack(">I", len(tags)) + table + data


def encoded(srgb: Image, space: SpaceName) -> Image:
    """The same colors in another space, at the same depth."""
    full = np.iinfo(srgb.dtype).max
    light = decode_srgb(srgb / full) @ np.linalg.inv(to_srgb(space)).T
    gamma = SPACES[space].gamma
    shown = np.clip(light, 0, 1)
    values = encode_srgb(shown) if gamma is None else shown ** (1 / gamma)
    found: Image = np.round(full * values).astype(srgb.dtype)
    return found


def test_primaries_are_those_that_littlecms_computes() -> None:
    profile = PIL.ImageCms.ImageCmsProfile(PIL.ImageCms.createProfile("sRGB")).profile
    colorants = (profile.red_colorant, profile.green_colorant, profile.blue_colorant)
    theirs = np.array([colorant[0] for colorant in colorants])
    np.testing.assert_allclose(primaries("srgb"), theirs.T, atol=5e-4)
    # Adobe RGB (1998) Color Image Encoding, 4.3.5.2
    adobe = [[0.60974, 0.20528, 0.14919], [0.31111, 0.62567, 0.06322], [0.01947, 0.06087, 0.74457]]
    np.testing.assert_allclose(primaries("adobe-rgb"), adobe, atol=5e-4)


@pytest.mark.parametrize("space", SPACES)
def test_a_space_is_recognized_and_keeps_gray(space: SpaceName) -> None:
    rng = np.random.default_rng(3)
    assert space_of(primaries(space) + rng.uniform(-0.003, 0.003, (3, 3))) == space
    np.testing.assert_allclose(to_srgb(space) @ np.full(3, 0.3), 0.3)
    assert space_of(primaries(space) @ np.array([[0.8, 0.2, 0], [0.1, 0.9, 0], [0, 0, 1]])) is None


@pytest.mark.parametrize("space", OTHERS)
@pytest.mark.parametrize(("depth", "off"), [(np.uint8, 6), (np.uint16, 12)])
def test_colors_are_converted_to_srgb(space: SpaceName, depth: type, off: int) -> None:
    """Of 8 bits, rounding of the other space counts, most in the dark."""
    full = np.iinfo(depth).max
    srgb = np.random.default_rng(4).uniform(0.15, 0.9, (40, 50, 3))
    image: Image = np.round(full * srgb).astype(depth)
    found = Response("srgb", space=space).standard(encoded(image, space))
    assert found.dtype == depth
    assert np.abs(found.astype(int) - image).max() <= off


def test_linear_light_of_another_space_is_converted_and_clipped_pixels_stay_so() -> None:
    light = np.random.default_rng(5).uniform(0.1, 0.7, (9, 8, 3))
    light[0, 0, 1] = 1.0
    image: Image = np.round(65535 * light).astype(np.uint16)
    found = Response("linear", space="display-p3").standard(image)
    mixed = np.clip(light @ to_srgb("display-p3").T, 0, 1)
    mixed[0, 0, 1] = 1.0
    np.testing.assert_allclose(found / 65535, encode_srgb(mixed), atol=1e-4)
    assert (Response("as-is", space="srgb").standard(image) == image).all()


def test_a_pedestal_is_subtracted_before_colors_are_mixed() -> None:
    image: Image = np.full((4, 4, 3), 30000, np.uint16)
    found = Response("linear", (0.1, 0.1, 0.1), "adobe-rgb").standard(image)
    light = np.full(found.shape, (30000 / 65535 - 0.1) / 0.9)
    np.testing.assert_allclose(found / 65535, encode_srgb(light), atol=1e-4)


def save(path: Path, **how: object) -> list[Pair]:
    noise = np.random.default_rng(6).integers(60, 190, (60, 80, 3), dtype=np.uint8)
    PIL.Image.fromarray(noise).save(path, **how)
    return [Pair(path.stem, path, path)]


@pytest.mark.parametrize("name", ["a.png", "a.jpg", "a.tif"])
def test_a_profile_states_the_space(tmp_path: Path, name: str) -> None:
    profile = icc_profile(primaries("adobe-rgb"), 563 / 256)
    config, notes = settle_response(RunConfig(), save(tmp_path / name, icc_profile=profile))
    assert config.color.space == "adobe-rgb"
    assert "response: the first file states Adobe RGB: colors are converted to sRGB" in notes
    pairs = save(tmp_path / name, icc_profile=profile)
    (tmp_path / "0").write_bytes(b"")
    damaged = Pair("0", tmp_path / "0", tmp_path / "0")
    assert settle_response(RunConfig(), [damaged, *pairs])[0].color.space == "adobe-rgb"
    as_read = RunConfig.model_validate({"color": {"input_space": "srgb"}})
    config, _ = settle_response(as_read, save(tmp_path / name, icc_profile=profile))
    assert config.color.space == "srgb"


def test_exif_states_adobe_rgb(tmp_path: Path) -> None:
    exif = PIL.Image.Exif()
    exif.get_ifd(EXIF_IFD)[INTEROPERABILITY_IFD] = {1: "R03"}
    pairs = save(tmp_path / "a.jpg", exif=exif)
    assert settle_response(RunConfig(), pairs)[0].color.space == "adobe-rgb"
    assert stated_encoding(pairs[0].left) == "encoded"


def test_an_unknown_profile_is_named_and_srgb_is_not(tmp_path: Path) -> None:
    mixed = primaries("srgb") @ np.array([[0.7, 0.3, 0], [0, 1, 0], [0, 0.3, 0.7]])
    pairs = save(tmp_path / "a.png", icc_profile=icc_profile(mixed, name=b"My screen"))
    config, notes = settle_response(RunConfig(), pairs)
    assert config.color.input_space == "auto"
    said = r'the profile "My screen" of a.png is none of these: sRGB, Adobe RGB, Display P3'
    assert re.search(said, "\n".join(notes))
    for profile in (icc_profile(primaries("srgb")), b"damaged"):
        _, notes = settle_response(RunConfig(), save(tmp_path / "b.png", icc_profile=profile))
        assert not any("profile" in note or "states" in note for note in notes)


@pytest.mark.slow
def test_a_dive_in_another_space_has_the_colors_of_the_same_dive_in_srgb(tmp_path: Path) -> None:
    profile = icc_profile(primaries("adobe-rgb"), 563 / 256)
    plain = tmp_path / "plain"
    for side in ("left", "right"):
        for folder in (plain, tmp_path / "adobe"):
            (folder / side).mkdir(parents=True)
        for path in sorted((REEF / side).iterdir())[:4]:
            image = cv2.imread(str(path))[..., ::-1]
            PIL.Image.fromarray(image).save(plain / side / path.name)
            other = encoded(image, "adobe-rgb")
            PIL.Image.fromarray(other).save(
                tmp_path / "adobe" / side / path.name, icc_profile=profile
            )
    found = []
    for name in ("plain", "adobe"):
        folder = tmp_path / name
        summary = run(
            folder / "left",
            folder / "right",
            REEF / "cam.yaml",
            tmp_path / f"out-{name}",
            RunConfig(),
            RunOptions(page="none"),
        )
        said = any("states Adobe RGB" in note for note in summary.notes)
        assert said == (name == "adobe")
        files = sorted((tmp_path / f"out-{name}" / "corrected").iterdir())
        found.append(np.array([cv2.imread(str(file)) for file in files], np.float64))
    assert np.abs(found[0] - found[1]).mean() < 2.0
