"""What cameras record beside the pixels: from EXIF and from tables."""

import io
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image, ImageCms

from stereo_seecolor.checks.image_files import cut_out
from stereo_seecolor.checks.sample import DiveImages
from stereo_seecolor.commands.run import run
from stereo_seecolor.config import InputConfig, RunConfig
from stereo_seecolor.config.file import load_config
from stereo_seecolor.errors import InputError
from stereo_seecolor.files.encode import ImageFormat, encode_image
from stereo_seecolor.inputs.capture import framing, read_capture
from stereo_seecolor.inputs.exposure_table import ExposureTable
from stereo_seecolor.inputs.frame_reader import FrameReader
from stereo_seecolor.inputs.pairing import pair_folders
from stereo_seecolor.records import Capture, is_monochrome

RGB = np.random.default_rng(0).integers(0, 256, (24, 32, 3), dtype=np.uint8)
CAMERA = {0x829A: 0.004, 0x829D: 2.8, 0x8827: 400}
TIME = {0x9003: "2021:03:04 05:06:07", 0x9291: "250", 0x9011: "+10:00"}
GPS = {1: "S", 2: (23.0, 30.0, 36.0), 3: "E", 4: (152.0, 6.0, 0.0)}


def encoded(
    kind: str, details: dict[int, Any], gps: dict[int, Any] | None = None, orientation: int = 1
) -> bytes:
    exif = Image.Exif()
    exif[0x0112] = orientation
    exif[0x010F] = "Reef Cameras"
    exif.get_ifd(0x8769).update(details)
    exif.get_ifd(0x8825).update(gps or {})
    if kind == "TIFF":  # a block of EXIF is a TIFF without a picture
        return exif.tobytes().removeprefix(b"Exif\x00\x00")
    file = io.BytesIO()
    Image.fromarray(RGB).save(file, kind, exif=exif)
    return file.getvalue()


@pytest.mark.parametrize("kind", ["JPEG", "PNG", "TIFF"])
def test_exif_of_every_kind_of_file(kind: str) -> None:
    found = read_capture(encoded(kind, CAMERA | TIME, GPS))
    assert found.exposure_s == pytest.approx(0.004)
    assert found.gain == 4
    assert found.aperture == pytest.approx(2.8)
    assert found.captured_s == 1614798367.25  # 2021-03-03T19:06:07.25Z
    assert (found.latitude_deg, found.longitude_deg) == (
        pytest.approx(-23.51),
        pytest.approx(152.1),
    )
    assert found.relative_exposure == pytest.approx(0.004 * 4 / 2.8**2)


def test_a_time_without_zone_is_utc_and_a_bad_one_is_none() -> None:
    assert read_capture(encoded("JPEG", {0x9003: "2021:03:04 05:06:07"})).captured_s == 1614834367
    assert read_capture(encoded("JPEG", {0x9003: "0000:00:00 00:00:00"})).captured_s is None


@pytest.mark.parametrize("details", [{0x829A: 0.0}, {0x8827: 0}, {}])
def test_what_is_not_recorded_is_none(details: dict[int, Any]) -> None:
    found = read_capture(encoded("JPEG", details))
    assert (found.exposure_s, found.gain, found.relative_exposure, found.latitude_deg) == (
        None,
        None,
        None,
        None,
    )


def test_no_exif_at_all() -> None:
    file = io.BytesIO()
    Image.fromarray(RGB).save(file, "PNG")
    assert read_capture(file.getvalue()) == Capture()
    assert read_capture(b"hello, reef") == Capture()
    tiff = cv2.imencode(".tiff", RGB)[1].tobytes()
    assert read_capture(tiff) == Capture()


def test_the_kept_block_is_upright_and_holds_what_the_camera_wrote() -> None:
    block = read_capture(encoded("JPEG", CAMERA | {0x927C: b"x" * 5000}, GPS, orientation=6)).exif
    kept = Image.Exif()
    kept.load(b"Exif\x00\x00" + block)
    assert (kept[0x0112], kept[0x010F]) == (1, "Reef Cameras")
    assert kept.get_ifd(0x8769)[0x8827] == 400
    assert kept.get_ifd(0x8825)[1] == "S"
    assert 0x927C not in kept.get_ifd(0x8769)
    assert len(block) < 1000


@pytest.mark.slow
@settings(max_examples=200)
@given(
    st.sampled_from(["JPEG", "PNG", "TIFF"]),
    st.lists(st.tuples(st.integers(0, 400), st.integers(0, 255)), max_size=6),
)
def test_damaged_exif_never_fails_a_frame(kind: str, changes: list[tuple[int, int]]) -> None:
    content = bytearray(encoded(kind, CAMERA | TIME, GPS))
    for place, value in changes:
        content[place % len(content)] = value
    found = read_capture(bytes(content))
    assert found.relative_exposure is None or found.relative_exposure > 0


def table(tmp_path: Path, text: str) -> ExposureTable:
    (tmp_path / "exposures.csv").write_text(text)
    return ExposureTable.read(tmp_path / "exposures.csv")


def test_a_file_that_is_named_twice_with_other_values_is_refused(tmp_path: Path) -> None:
    head, again = "file,exposure_ms\n0001.png,4\n", "0001.png,4\n"
    assert table(tmp_path, head + again).rows["0001.png"].exposure_s == pytest.approx(0.004)
    with pytest.raises(InputError, match=r"line 3: '0001.png' has other values in a line above"):
        table(tmp_path, head + "0001.png,40\n")


@pytest.mark.parametrize(
    ("text", "exposure_s", "gain"),
    [
        ("file,exposure_ms,gain_db\na.png,4,6.0206\n", 0.004, 2.0),
        ("Name, exposure_us, iso\na, 4000, 200\n", 0.004, 2.0),
        ("path,exposure_s\n/data/dive\\L\\a.png,0.004\n", 0.004, 7.0),
        ("name,gain\nL/a,2\nR/a,3\na,4\n", 1.0, 2.0),
        ("name,gain\nb,2\n", 1.0, 7.0),
    ],
)
def test_tables_of_exposures(tmp_path: Path, text: str, exposure_s: float, gain: float) -> None:
    found = table(tmp_path, text).applied(
        Capture(exposure_s=1.0, gain=7.0, aperture=4.0), Path("L/a.png")
    )
    assert (found.exposure_s, found.gain, found.aperture) == (
        pytest.approx(exposure_s),
        pytest.approx(gain, rel=1e-4),
        4.0,
    )


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a,b\n1,2\n", "needs a header with a column of file names"),
        ("name,height\n1,2\n", "needs a header"),
        ("name,gain,iso\na,1,2\n", "has the columns gain and iso: leave one"),
        ("name,gain\na,x\n", r"line 2: gain must be a number, got 'x'"),
        ("name,gain\na\n", r"line 2: gain must be a number, got ''"),
        ("name,exposure_s\na,1\nb,-1\n", r"line 3: exposure_s must be more than 0, got -1"),
        ("name,gain_db\na,inf\n", r"gain_db is inf, which no camera has"),
    ],
)
def test_tables_that_cannot_be_used(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        table(tmp_path, text)


@pytest.mark.parametrize("image_format", ["png", "png16", "jpg"])
def test_corrected_images_carry_exif_and_the_profile(image_format: ImageFormat) -> None:
    capture = read_capture(encoded("JPEG", CAMERA | TIME, GPS))
    content = encode_image(RGB, image_format, capture.exif)
    assert replace(read_capture(content), exif=b"") == replace(capture, exif=b"")
    image = Image.open(io.BytesIO(content))
    assert "sRGB" in ImageCms.getProfileDescription(
        ImageCms.ImageCmsProfile(io.BytesIO(image.info["icc_profile"]))
    )
    if image_format == "png":
        np.testing.assert_array_equal(np.asarray(image), RGB)


@pytest.mark.parametrize("image_format", ["png", "png16", "jpg", "tiff32"])
@pytest.mark.parametrize("mono", [True, False])
def test_a_monochrome_image_is_written_as_one_channel(
    image_format: ImageFormat, mono: bool
) -> None:
    rgb = np.repeat(RGB[..., :1], 3, axis=2) if mono else RGB
    pixels = rgb.astype(np.float32) if image_format == "tiff32" else rgb
    decoded = cv2.imdecode(
        np.frombuffer(encode_image(pixels, image_format), np.uint8), cv2.IMREAD_UNCHANGED
    )
    assert decoded.ndim == (2 if mono else 3)


def test_frames_come_with_what_was_recorded(tmp_path: Path) -> None:
    for side, gain in (("L", 100), ("R", 400)):
        (tmp_path / side).mkdir()
        (tmp_path / side / "1.jpg").write_bytes(encoded("JPEG", {0x8827: gain}))
    (tmp_path / "log.csv").write_text("name,exposure_ms\nL/1,2\nR/1,8\n")
    config = InputConfig(exposures=tmp_path / "log.csv")
    (pair,) = pair_folders(tmp_path / "L", tmp_path / "R", config).pairs
    frame = FrameReader(config).read(pair)
    assert frame.left.shape == frame.right.shape == RGB.shape
    assert [capture.relative_exposure for capture in (frame.left_capture, frame.right_capture)] == [
        0.002,
        0.032,
    ]


def test_readers_of_different_tables_have_different_settings(tmp_path: Path) -> None:
    config = InputConfig(exposures=tmp_path / "log.csv")
    settings = [FrameReader(InputConfig()).settings]
    for exposure_ms in (2, 3, 2):
        (tmp_path / "log.csv").write_text(f"name,exposure_ms\nL/1,{exposure_ms}\n")
        settings.append(FrameReader(config).settings)
    assert settings[1] == settings[3]
    assert len(set(settings)) == 3


def test_monochrome_images_are_told_by_their_pixels() -> None:
    gray = np.repeat(RGB[..., :1], 3, axis=2)
    assert is_monochrome(gray)
    assert not is_monochrome(RGB)
    assert not is_monochrome(np.zeros_like(gray)), "a black frame may be any camera's"
    gray[5, 7, 1] ^= 1
    assert not is_monochrome(gray)


@pytest.mark.slow
@pytest.mark.parametrize("lock", ["frame", "survey"])
def test_a_run_carries_what_the_camera_recorded(make_dive, tmp_path: Path, lock: str) -> None:
    dive = make_dive(2)
    exif = Image.Exif()
    exif[0x010F] = "Reef Cameras"
    exif.get_ifd(0x8769).update(CAMERA | TIME)
    for path in [dive.root / side / f"{i:04d}.png" for side in "LR" for i in range(2)]:
        Image.open(path).save(path, exif=exif)
    out = tmp_path / "out"
    summary = run(
        dive.root / "L",
        dive.root / "R",
        dive.root / "cam.yaml",
        out,
        load_config(None, [f"color.lock={lock}"]),
    )
    corrected = read_capture((out / "corrected" / "0001.png").read_bytes())
    assert (corrected.exposure_s, corrected.gain, corrected.captured_s) == (
        pytest.approx(0.004),
        4,
        1614798367.25,
    )
    facts = summary.rows[0].facts
    recorded = facts["camera_exposure_s"], facts["camera_gain"], facts["camera_aperture"]
    assert recorded == (pytest.approx(0.004), 4, pytest.approx(2.8))


@pytest.mark.parametrize("kind", ["JPEG", "PNG", "TIFF"])
@pytest.mark.parametrize(
    ("details", "words"),
    [
        ({0xA404: 1.5}, "has a digital zoom of 1.5"),
        ({0xA404: 1.0}, ""),
        ({0xA404: 0.0}, ""),
        ({0xA002: 4000, 0xA003: 2250}, "was 4000x2250 px in the camera"),
        ({0xA002: 4000, 0xA003: 3000}, ""),  # made smaller
        ({0xA002: 24, 0xA003: 32}, ""),  # turned
        ({0xA002: 0, 0xA003: 32}, ""),
        ({}, ""),
    ],
)
def test_a_zoom_or_cut_that_the_camera_wrote_is_known(
    kind: str, details: dict[int, Any], words: str
) -> None:
    assert framing(encoded(kind, details), (32, 24)) == words


@pytest.mark.parametrize(
    ("written", "not_done", "words"),
    [
        (b'crs:HasCrop="True"', b'crs:HasCrop="False"', "was cut out by a converter"),
        (b"<crs:HasCrop>True<", b"<crs:HasCrop>False<", "was cut out by a converter"),
        (b'crs:LensProfileEnable="1"', b'crs:LensProfileEnable="0"', "had its lens distortion"),
        (b"crs:PerspectiveUpright='2'", b"crs:PerspectiveUpright='0'", "was turned or stretched"),
    ],
)
def test_another_shape_by_a_converter_is_known(written: bytes, not_done: bytes, words: str) -> None:
    edited = encoded("JPEG", {}) + b"<rdf:Description " + written + b"/>"
    assert framing(edited, (32, 24)).startswith(words)
    assert not framing(edited.replace(written, not_done), (32, 24))


@pytest.mark.parametrize("side", ["left", "right"])
def test_a_zoom_of_either_camera_is_named(side: str, tmp_path: Path) -> None:
    for one in ("left", "right"):
        (tmp_path / one).mkdir()
        zoom = {0xA404: 2.0} if one == side else {}
        (tmp_path / one / "1.jpg").write_bytes(encoded("JPEG", zoom))
    pairs = pair_folders(tmp_path / "left", tmp_path / "right", InputConfig()).pairs
    (note,) = cut_out(DiveImages(pairs, RunConfig())).notes
    assert "1.jpg has a digital zoom of 2" in note and "calibration" in note


@pytest.mark.parametrize("encoding", ["utf-16", "cp1252", "utf-8-sig"])
@pytest.mark.parametrize("separator", [";", "\t", "|", "   "])
def test_tables_of_any_encoding_and_separator(
    encoding: str, separator: str, tmp_path: Path
) -> None:
    text = f"file{separator}exposure_ms\nGröße_0001.png{separator}2,5\n"
    (tmp_path / "log.csv").write_bytes(text.encode(encoding))
    read = ExposureTable.read(tmp_path / "log.csv")
    assert read.rows["Größe_0001.png"].exposure_s == pytest.approx(0.0025)


@pytest.mark.parametrize(
    ("header", "cells"),
    [
        ("File,Exposure (ms)", "2.5"),
        ("image,Exposure time [us]", "2500"),
        ("image,Exposure [µs]", "2500"),
        ("fileName,exposureTimeUs", "2500"),
        ("SourceFile,ExposureTime", "1/400"),
        ("file,Shutter Speed", "1/400"),
        ("file,shutter", "0.0025"),
    ],
)
def test_usual_names_and_units_of_exposures(header: str, cells: str, tmp_path: Path) -> None:
    (tmp_path / "log.csv").write_text(f"{header}\na.png,{cells}\n", encoding="utf-8")
    row = ExposureTable.read(tmp_path / "log.csv").rows["a.png"]
    assert row.exposure_s == pytest.approx(0.0025)


@pytest.mark.parametrize("gain", ["Gain_dB", "gain (dB)", "GAIN_DB"])
def test_a_gain_in_decibels_is_known_however_it_is_written(gain: str, tmp_path: Path) -> None:
    (tmp_path / "log.csv").write_text(f"File, Exposure_ms, {gain}\na.png, 2.5, 20\n")
    row = ExposureTable.read(tmp_path / "log.csv").rows["a.png"]
    assert (row.exposure_s, row.gain) == (pytest.approx(0.0025), pytest.approx(10))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("file,exposure\na.png,2.5\n", "'exposure' has no unit: name it exposure_s, exposure_ms"),
        ("file,exposure,gain\na.png,2500,1\n", "'exposure' has no unit: name it exposure_s"),
        (
            "Filename,ExposureTime,Gain\na.png,2500.5,1\n",
            "line 2: exposure_time is 2500.5 s: name its unit: exposure_s, exposure_ms",
        ),
    ],
)
def test_an_exposure_without_a_unit_is_refused(text: str, message: str, tmp_path: Path) -> None:
    (tmp_path / "log.csv").write_text(text)
    with pytest.raises(InputError, match=message):
        ExposureTable.read(tmp_path / "log.csv")


def test_all_columns_of_exiftool_are_read_and_a_time_with_its_unit(tmp_path: Path) -> None:
    head = "SourceFile,FileName,ExposureTime,ShutterSpeed,ShutterSpeedValue,ISO\n"
    (tmp_path / "log.csv").write_text(head + "./L/a.jpg,a.jpg,1/400,1/400,1/406 s,200\n")
    (read,) = ExposureTable.read(tmp_path / "log.csv").rows.items()
    assert read == ("L/a.jpg", Capture(exposure_s=pytest.approx(0.0025), gain=2.0))
    (tmp_path / "log.csv").write_text("image,shutter speed\na.jpg,1/400 sec\n")
    row = ExposureTable.read(tmp_path / "log.csv").rows["a.jpg"]
    assert row.exposure_s == pytest.approx(0.0025)
