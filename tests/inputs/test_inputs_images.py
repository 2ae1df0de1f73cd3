"""Images of every kind that cameras write, and files that are none."""

import os
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from stereo_seecolor.config import InputConfig
from stereo_seecolor.errors import InputError
from stereo_seecolor.inputs.images import decode_image, read_image, read_range_map

RNG = np.random.default_rng(3)
RGB8 = RNG.integers(0, 256, (20, 30, 3), dtype=np.uint8)
RGB16 = RNG.integers(0, 65536, (20, 30, 3), dtype=np.uint16)


def save(path: Path, rgb: np.ndarray) -> Path:
    bgr = rgb[..., ::-1] if rgb.ndim == 3 and rgb.shape[2] == 3 else rgb
    assert cv2.imwrite(str(path), bgr)
    return path


KINDS = [
    (suffix, image) for suffix in (".png", ".tiff", ".TIF", ".ppm") for image in (RGB8, RGB16)
] + [(".bmp", RGB8)]


@pytest.mark.parametrize(
    ("suffix", "image"), KINDS, ids=[f"{suffix} {image.dtype}" for suffix, image in KINDS]
)
def test_lossless_round_trip(tmp_path: Path, suffix: str, image: np.ndarray) -> None:
    np.testing.assert_array_equal(read_image(save(tmp_path / f"a{suffix}", image)), image)


def test_jpeg_is_near(tmp_path: Path) -> None:
    smooth = cv2.resize(RGB8[:2, :3], (30, 20), interpolation=cv2.INTER_LINEAR)
    assert np.abs(read_image(save(tmp_path / "a.jpg", smooth)).astype(int) - smooth).mean() < 6


@pytest.mark.parametrize("suffix", [".bmp", ".pgm"])
def test_kinds_of_one_channel(tmp_path: Path, suffix: str) -> None:
    np.testing.assert_array_equal(
        read_image(save(tmp_path / f"a{suffix}", RGB8[..., 0])), np.repeat(RGB8[..., :1], 3, axis=2)
    )


def test_a_pgm_with_comments_and_twelve_bits(tmp_path: Path) -> None:
    (tmp_path / "a.pgm").write_bytes(b"P5\n# camera 3\n2 1 # size\n4095\n\x0f\xff\x00\x01")
    found = read_image(tmp_path / "a.pgm", InputConfig(significant_bits=12))
    np.testing.assert_array_equal(found[0, :, 0], [65535, 16])


def test_gray_is_repeated_and_alpha_dropped(tmp_path: Path) -> None:
    gray = read_image(save(tmp_path / "gray.png", RGB16[..., 0]))
    np.testing.assert_array_equal(gray, np.repeat(RGB16[..., :1], 3, axis=2))
    cv2.imwrite(str(tmp_path / "alpha.png"), np.dstack([RGB8[..., ::-1], RGB8[..., 0]]))
    np.testing.assert_array_equal(read_image(tmp_path / "alpha.png"), RGB8)


@pytest.mark.parametrize("pattern", ["rggb", "bggr", "gbrg", "grbg"])
@pytest.mark.parametrize("bits", [8, 16])
def test_bayer_patterns_give_the_color_they_were_made_of(
    tmp_path: Path, pattern: str, bits: int
) -> None:
    color = np.array([200, 120, 40]) * (1 if bits == 8 else 257)
    mosaic = np.empty((20, 30), np.uint8 if bits == 8 else np.uint16)
    for place, letter in enumerate(pattern):
        mosaic[place // 2 :: 2, place % 2 :: 2] = color["rgb".index(letter)]
    image = read_image(save(tmp_path / "raw.png", mosaic), InputConfig(bayer=pattern))
    np.testing.assert_array_equal(image[2:-2, 2:-2], np.broadcast_to(color, (16, 26, 3)))


def test_bayer_needs_one_channel(tmp_path: Path) -> None:
    with pytest.raises(
        InputError, match=r"3 channels, but input\.bayer=rggb needs a single-channel"
    ):
        read_image(save(tmp_path / "a.png", RGB8), InputConfig(bayer="rggb"))


def test_twelve_bits_are_scaled_to_full(tmp_path: Path) -> None:
    raw = np.array([[0, 4095], [2048, 1]], np.uint16)
    image = read_image(save(tmp_path / "a.png", raw), InputConfig(significant_bits=12))
    assert image[..., 0].tolist() == [[0, 65535], [32776, 16]]
    with pytest.raises(
        InputError, match=r"holds 5000, more than input\.significant_bits=12 allow \(4095\)"
    ):
        read_image(save(tmp_path / "b.png", raw + 905), InputConfig(significant_bits=12))
    with pytest.raises(InputError, match=r"8 bits a channel, but input\.significant_bits=12"):
        read_image(save(tmp_path / "c.png", RGB8), InputConfig(significant_bits=12))


@pytest.mark.parametrize("suffix", [".png", ".jpg", ".tiff", ".bmp", ".ppm"])
@pytest.mark.parametrize("fraction", [0.0, 0.02, 0.3, 0.7, 0.99])
def test_truncated_files_are_refused(tmp_path: Path, suffix: str, fraction: float) -> None:
    path = save(tmp_path / f"a{suffix}", RNG.integers(0, 256, (64, 64, 3), dtype=np.uint8))
    content = path.read_bytes()
    path.write_bytes(content[: int(fraction * len(content))])
    with pytest.raises(
        InputError, match=rf"a\{suffix}: (is (truncated|empty|damaged|no PNG)|cannot be decoded)"
    ):
        read_image(path)


def test_a_flipped_bit_in_a_png_is_noticed(tmp_path: Path) -> None:
    path = save(tmp_path / "a.png", RGB8)
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 4
    path.write_bytes(content)
    with pytest.raises(InputError, match="wrong checksum"):
        read_image(path)


def test_bombs_are_refused_before_they_are_unpacked(tmp_path: Path) -> None:
    header = cv2.imencode(".tiff", RGB8)[1].tobytes()
    width_entry = header.index(b"\x00\x01\x03\x00\x01\x00\x00\x00\x1e\x00")
    bomb = bytearray(header)
    bomb[width_entry + 2 : width_entry + 12] = b"\x04\x00\x01\x00\x00\x00\xff\xff\xff\x7f"
    (tmp_path / "bomb.tiff").write_bytes(bomb)
    with pytest.raises(InputError, match="claims 2147483647x20 pixels, more than 150 million"):
        read_image(tmp_path / "bomb.tiff")


def test_missing_and_foreign_files(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"a\.png: cannot be read: No such file"):
        read_image(tmp_path / "a.png")
    (tmp_path / "a.png").write_bytes(b"hello, reef")
    with pytest.raises(InputError, match="is not a PNG, TIFF, JPEG, BMP"):
        read_image(tmp_path / "a.png")


def test_an_empty_file_is_said_to_be_empty(tmp_path: Path) -> None:
    (tmp_path / "a.png").touch()
    with pytest.raises(InputError, match=r"a\.png: is empty"):
        read_image(tmp_path / "a.png")


@pytest.mark.posix
def test_a_named_pipe_is_refused_and_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "a.png")
    with pytest.raises(InputError, match=r"a\.png: is a named pipe, not a file"):
        read_image(tmp_path / "a.png")


def test_errors_about_odd_names_can_be_printed(tmp_path: Path) -> None:
    path = tmp_path / os.fsdecode(b"caf\xe9\n.png")
    with pytest.raises(InputError) as error:
        read_image(path)
    assert (
        str(error.value)
        .encode()
        .endswith(b"caf%E9%0A.png: cannot be read: No such file or directory")
    )


def test_float_images_are_refused(tmp_path: Path) -> None:
    with pytest.raises(
        InputError, match=r"holds float32 pixels.*save it as a 16-bit PNG or TIFF.*times 65535"
    ):
        read_image(save(tmp_path / "a.tiff", RGB8[..., 0].astype(np.float32)))


@pytest.mark.slow
@settings(max_examples=300)
@given(
    st.sampled_from([".png", ".jpg", ".tiff", ".bmp", ".ppm"]),
    st.lists(st.tuples(st.integers(0, 10_000), st.integers(0, 255)), max_size=8),
    st.data(),
)
def test_mutated_files_give_an_image_or_one_clear_line(
    suffix: str, changes: list[tuple[int, int]], data: st.DataObject
) -> None:
    content = bytearray(cv2.imencode(suffix, RGB8)[1].tobytes())
    for place, value in changes:
        content[place % len(content)] = value
    content = (
        content[: data.draw(st.integers(0, len(content)))] if data.draw(st.booleans()) else content
    )
    try:
        image = decode_image(bytes(content), Path("a" + suffix), InputConfig())
    except InputError as error:
        assert "\n" not in str(error)
        assert str(error).startswith("a" + suffix)
    else:
        assert image.ndim == 3
        assert image.shape[2] == 3


def test_range_maps_in_meters_and_millimeters(tmp_path: Path) -> None:
    meters = np.array([[1.5, 0, np.nan], [-1, np.inf, 2]], np.float32)
    expected = np.array([[1.5, np.nan, np.nan], [np.nan, np.nan, 2]], np.float32)
    np.testing.assert_array_equal(read_range_map(save(tmp_path / "a.tiff", meters)), expected)
    millimeters = np.array([[1500, 0, 0], [0, 0, 2000]], np.uint16)
    np.testing.assert_allclose(read_range_map(save(tmp_path / "a.png", millimeters)), expected)


@pytest.mark.parametrize(
    ("image", "message"), [(RGB8, "has 3 channels"), (RGB8[..., 0], "holds uint8 pixels")]
)
def test_what_is_no_range_map(tmp_path: Path, image: np.ndarray, message: str) -> None:
    with pytest.raises(InputError, match=message):
        read_range_map(save(tmp_path / "a.png", image))


def test_exif_orientation_is_applied(tmp_path: Path) -> None:
    bright_left = np.zeros((20, 40, 3), np.uint8)
    bright_left[:, :20] = 250
    jpeg = cv2.imencode(".jpg", bright_left)[1].tobytes()
    turn_right = b"II*\x00\x08\x00\x00\x00\x01\x00\x12\x01\x03\x00\x01\x00\x00\x00\x06\x00\x00\x00\x00\x00\x00\x00"  # noqa: E501
    exif = b"Exif\x00\x00" + turn_right
    (tmp_path / "a.jpg").write_bytes(
        jpeg[:2] + b"\xff\xe1" + (len(exif) + 2).to_bytes(2, "big") + exif + jpeg[2:]
    )
    image = read_image(tmp_path / "a.jpg")
    assert image.shape == (40, 20, 3)
    assert image[:15].mean() > 200 > 50 > image[25:].mean()
