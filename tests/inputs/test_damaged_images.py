"""Damaged files that decoders accept are named and left out; files whose form costs colors are
named.
"""

import io
from collections.abc import Callable
from pathlib import Path

import numpy as np
import PIL.Image
import pytest
from conftest import REEF, read_pixels

from stereo_seecolor.checks.image_files import form
from stereo_seecolor.checks.sample import DiveImages
from stereo_seecolor.config import InputConfig, RunConfig
from stereo_seecolor.errors import InputError
from stereo_seecolor.inputs.frame_reader import FrameReader
from stereo_seecolor.inputs.images import decode_image
from stereo_seecolor.inputs.pairing import Pair
from stereo_seecolor.inputs.seams import seam_row

LEFTS, RIGHTS = (sorted((REEF / side).iterdir()) for side in ("left", "right"))
CONFIG = InputConfig()
Encode = Callable[[np.ndarray], bytes]


def pillow(kind: str, **how: object) -> Encode:
    def encode(bgr: np.ndarray) -> bytes:
        stream = io.BytesIO()
        PIL.Image.fromarray(bgr[..., ::-1]).save(stream, kind, **how)
        return stream.getvalue()

    return encode


PLAIN: dict[str, Encode] = {"bmp": pillow("BMP"), "ppm": pillow("PPM"), "tif": pillow("TIFF")}
JPEGS: dict[str, Encode] = {
    "jpg": pillow("JPEG", quality=90),
    "progressive.jpg": pillow("JPEG", quality=90, progressive=True),
}
KINDS = PLAIN | JPEGS


def seam(content: bytes) -> int | None:
    return seam_row(decode_image(content, Path("a"), CONFIG), content)


@pytest.mark.parametrize("kind", KINDS)
def test_whole_images_have_no_seam(kind: str) -> None:
    for path in (*LEFTS[::4], *RIGHTS[::4]):
        assert seam(KINDS[kind](read_pixels(path))) is None


@pytest.mark.parametrize("quality", [10, 20, 35, 50])
def test_blocks_of_strong_compression_are_no_seams(quality: int) -> None:
    """Also not of a JPEG that was stored in another format, as frames of a video are."""
    for path in (*LEFTS[::4], *RIGHTS[::4]):
        for light in (1, 0.3):
            pixels = (read_pixels(path) * light).astype(np.uint8)
            content = pillow("JPEG", quality=quality)(pixels)
            assert seam(content) is None
            stored = decode_image(content, Path("a"), CONFIG)[..., ::-1]
            assert quality == 10 or seam(PLAIN["tif"](stored)) is None


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("stripe", ["another picture", "zeros", "noise"])
def test_a_stripe_in_the_middle_is_a_seam(kind: str, stripe: str) -> None:
    content, other = (bytearray(KINDS[kind](read_pixels(path))) for path in (LEFTS[0], RIGHTS[7]))
    start, length = len(content) // 3, len(content) // 8
    piece = {"zeros": bytes(length), "noise": np.random.default_rng(0).bytes(length)}
    content[start : start + length] = piece.get(stripe, other[start : start + length])
    try:
        row = seam(bytes(content))
    except InputError as error:
        assert "damaged" in str(error)
        return
    assert row is not None
    if kind in ("ppm", "tif"):  # rows are stored from the top down, of one length
        rows = {place // (3 * 576) for place in (start, start + length)}
        assert min(abs(row - one) for one in rows) <= 1


@pytest.mark.parametrize("kind", ["ppm", "bmp"])
@pytest.mark.parametrize("place", [0.31, 0.52, 0.777])
def test_zeros_to_the_end_of_a_copy_are_a_seam(kind: str, place: float) -> None:
    content = PLAIN[kind](read_pixels(LEFTS[0]))
    kept = int(place * len(content))
    assert seam(content[:kept] + bytes(len(content) - kept)) is not None


@pytest.mark.slow
def test_most_bytes_whose_change_is_seen_in_a_jpeg_are_found() -> None:
    found = changed = 0
    random = np.random.default_rng(0)
    for path in LEFTS[:3]:
        content = JPEGS["jpg"](read_pixels(path))
        good = decode_image(content, path, CONFIG).astype(int)
        for place in random.integers(len(content) // 10, len(content) - 2, 40):
            damaged = bytearray(content)
            damaged[place] ^= 0x55
            try:
                image = decode_image(bytes(damaged), path, CONFIG)
            except InputError:
                continue
            if (np.abs(image - good).max(axis=2) > 8).mean() > 0.2:
                changed += 1
                found += seam_row(image, bytes(damaged)) is not None
    assert changed > 20
    assert found > 0.85 * changed


@pytest.mark.parametrize("kind", ["tif", "ppm"])
def test_rows_that_demosaicing_repeats_are_no_seam(kind: str) -> None:
    for path in (*LEFTS, *RIGHTS):
        pixels = read_pixels(path).copy()
        pixels[[0, -1]] = pixels[[1, -2]]
        assert seam(PLAIN[kind](pixels)) is None


@pytest.mark.parametrize("kind", ["ppm", "jpg"])
def test_bars_across_an_image_are_no_seam(kind: str) -> None:
    pixels = read_pixels(LEFTS[0]).copy()
    pixels[:32] = pixels[-40:] = 0
    assert seam(KINDS[kind](pixels)) is None


@pytest.mark.parametrize("compression", ["tiff_lzw", "tiff_adobe_deflate"])
def test_a_compressed_tiff_with_a_broken_stream_is_refused(compression: str) -> None:
    content = bytearray(pillow("TIFF", compression=compression)(read_pixels(LEFTS[0])))
    decode_image(bytes(content), Path("a.tif"), CONFIG)
    place = len(content) // 2
    content[place : place + 4096] = bytes(4096)
    with pytest.raises(
        InputError, match=r"a.tif: is damaged: its compressed pixels cannot be unpacked"
    ):
        decode_image(bytes(content), Path("a.tif"), CONFIG)


def overlaid(path: Path) -> np.ndarray:
    """The picture with a bar that half covers it, as a recorder draws behind text."""
    pixels = read_pixels(path).copy()
    pixels[400:] = pixels[400:] // 3
    return pixels


def test_what_both_images_have_is_no_damage(tmp_path: Path) -> None:
    for name, path in (("l", LEFTS[0]), ("r", RIGHTS[0])):
        (tmp_path / f"{name}.ppm").write_bytes(PLAIN["ppm"](overlaid(path)))
    pair = Pair("a", tmp_path / "l.ppm", tmp_path / "r.ppm")
    assert FrameReader(CONFIG).read(pair).left.shape == (448, 576, 3)
    (tmp_path / "r.ppm").write_bytes(PLAIN["ppm"](read_pixels(RIGHTS[0])))
    with pytest.raises(
        InputError,
        match=r"l.ppm: is damaged: the image below row 400 does not continue the image above",
    ):
        FrameReader(CONFIG).read(pair)


@pytest.mark.slow
def test_a_run_leaves_damaged_frames_out(cli, tmp_path: Path) -> None:
    for side, files in (("left", LEFTS[:3]), ("right", RIGHTS[:3])):
        (tmp_path / side).mkdir()
        for path in files:
            content = bytearray(JPEGS["jpg"](read_pixels(path)))
            if path == RIGHTS[1]:
                place = len(content) // 3
                content[place : place + 2000] = bytes(2000)
            (tmp_path / side / f"{path.stem}.jpg").write_bytes(content)
    sides = (
        "--left",
        str(tmp_path / "left"),
        "--right",
        str(tmp_path / "right"),
        "--calib",
        str(REEF / "cam.yaml"),
    )
    code, _, said = cli("run", *sides, "--out", str(tmp_path / "out"))
    assert code == 3
    assert f"{RIGHTS[1].stem}.jpg: is damaged" in said
    assert len(list((tmp_path / "out/corrected").iterdir())) == 2


def notes(tmp_path: Path, name: str, content: bytes) -> str:
    (tmp_path / name).write_bytes(content)
    pair = Pair("a", tmp_path / name, tmp_path / name)
    return " ".join(form(DiveImages([pair], RunConfig())).notes)


def pages(*images: np.ndarray, **how: object) -> bytes:
    stream = io.BytesIO()
    first, *others = (PIL.Image.fromarray(image) for image in images)
    first.save(stream, "TIFF", save_all=True, append_images=others, **how)
    return stream.getvalue()


@pytest.mark.slow
def test_forms_of_files_that_cost_colors_are_named(tmp_path: Path) -> None:
    rgb = read_pixels(LEFTS[0])[..., ::-1]
    assert notes(tmp_path, "a.png", pillow("PNG")(rgb)) == ""
    assert "a.tif holds 2 pages; only the first is read" in notes(
        tmp_path, "a.tif", pages(rgb, rgb[::-1])
    )
    assert notes(tmp_path, "b.tif", pages(rgb)) == ""
    stream = io.BytesIO()
    PIL.Image.fromarray(rgb).quantize(64).save(stream, "PNG")
    assert "has a palette of 64 colors" in notes(tmp_path, "b.png", stream.getvalue())
    gray = io.BytesIO()
    PIL.Image.fromarray(rgb[..., 1]).convert("P").save(gray, "PNG")
    assert "palette" not in notes(tmp_path, "c.png", gray.getvalue())
