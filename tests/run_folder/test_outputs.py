"""What is written is what is read, whole or not at all, and a folder belongs to one dive."""

import io
import json
import runpy
import sys
import tracemalloc
import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import ExifTags, Image

from stereo_seecolor.compute import packed
from stereo_seecolor.config import OutputConfig
from stereo_seecolor.errors import InputError, OutputError
from stereo_seecolor.files import deflate, png
from stereo_seecolor.files.atomic import write_atomic
from stereo_seecolor.files.decode import read_array
from stereo_seecolor.files.encode import encode_confidence, encode_image, encode_map, rounded
from stereo_seecolor.files.image_headers import EXIF_PREFIX
from stereo_seecolor.files.keys import content_key
from stereo_seecolor.files.ply import encode_cloud
from stereo_seecolor.files.png import _file, encode_codes, encode_png
from stereo_seecolor.files.png_decoding import quickly_decoded
from stereo_seecolor.files.tiff import encode_tiff
from stereo_seecolor.records import FrameRow, Water
from stereo_seecolor.run_folder.frame_table import FrameTable, RunSummary
from stereo_seecolor.run_folder.frames_csv import frames_csv
from stereo_seecolor.run_folder.water_file import read_waters, waters_content

RNG = np.random.default_rng(1)


def decoded(content: bytes) -> np.ndarray:
    return cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_UNCHANGED)


def test_images_keep_their_bit_depth() -> None:
    for dtype in (np.uint8, np.uint16):
        rgb = RNG.integers(0, np.iinfo(dtype).max, (6, 7, 3), dtype=dtype)
        np.testing.assert_array_equal(decoded(encode_image(rgb, "png"))[..., ::-1], rgb)
    np.testing.assert_array_equal(
        decoded(encode_image(np.full((2, 2, 3), 255, np.uint8), "png16")), 65535
    )
    linear = RNG.normal(size=(4, 5, 3)).astype(np.float32)
    np.testing.assert_array_equal(decoded(encode_image(linear, "tiff32"))[..., ::-1], linear)
    assert decoded(encode_image(np.full((8, 8, 3), 65535, np.uint16), "jpg")).mean() > 250


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_pictures_of_every_shape_keep_every_pixel(dtype: type) -> None:
    for shape in [(1, 1), (1, 7), (9, 1), (6, 7), (1, 1, 3), (1, 5, 3), (5, 1, 3), (33, 65, 3)]:
        pixels = RNG.integers(0, np.iinfo(dtype).max, shape, dtype=dtype, endpoint=True)
        read = decoded(encode_png(pixels))
        np.testing.assert_array_equal(read[..., ::-1] if pixels.ndim == 3 else read, pixels)


def test_pictures_are_written_without_the_fast_library_too(monkeypatch: pytest.MonkeyPatch) -> None:
    pixels = RNG.integers(0, 255, (6, 7, 3), dtype=np.uint8)
    monkeypatch.setitem(sys.modules, "isal.isal_zlib", None)
    without = runpy.run_path(str(deflate.__file__))
    assert without["fast_error"] is zlib.error
    monkeypatch.setattr(png, "deflated", without["deflated"])
    np.testing.assert_array_equal(decoded(encode_png(pixels))[..., ::-1], pixels)


def test_smooth_pictures_deflate() -> None:
    y, x = np.mgrid[:200, :300]
    smooth = np.stack([y + x, 2 * y, 255 - x // 2], axis=2).astype(np.uint8)
    assert len(encode_png(smooth)) < smooth.size / 20


@pytest.mark.parametrize("compact", [False, True])
def test_range_maps_keep_every_bit_and_nan(compact: bool) -> None:
    range_m = RNG.uniform(0, 9, (5, 6)).astype(np.float32)
    range_m[1, 2], range_m[0, 0], range_m[4, 5] = np.nan, 1e-30, np.inf
    content = encode_map(range_m, compact)
    np.testing.assert_array_equal(decoded(content), range_m)
    np.testing.assert_array_equal(np.asarray(Image.open(io.BytesIO(content))), range_m)


def test_rounded_errors_differ_by_a_fifth_of_a_percent() -> None:
    std_m = np.exp(RNG.uniform(-12, 5, (40, 50))).astype(np.float32)
    std_m[3, 4] = np.nan
    np.testing.assert_allclose(rounded(std_m), std_m, rtol=0.002)
    assert len(encode_map(rounded(std_m), True)) < 0.7 * len(encode_map(std_m, True))


def test_a_lean_run_writes_no_clouds_and_deflated_ranges() -> None:
    lean, full = OutputConfig(preset="lean"), OutputConfig()
    assert (lean.with_clouds, lean.deflated_maps) == (False, True)
    assert (full.with_clouds, full.deflated_maps) == (True, False)


def test_small_confidence_is_not_taken_for_none() -> None:
    assert decoded(encode_confidence(np.array([[0, 1e-4, 1]], np.float32))).tolist() == [
        [0, 1, 255]
    ]


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_cloud_is_binary_float_ply(dtype: type) -> None:
    range_m = RNG.uniform(1, 5, (4, 6)).astype(np.float32)
    range_m[1, 2], range_m[3, 5] = np.nan, np.inf
    rays = RNG.normal(size=(4, 6, 3)).astype(np.float32)
    rgb = RNG.integers(0, np.iinfo(dtype).max, (4, 6, 3), dtype=dtype, endpoint=True)
    header, _, body = bytes(encode_cloud(range_m, rays, rgb)).partition(b"end_header\n")
    assert b"format binary_little_endian 1.0" in header
    assert b"element vertex 22" in header
    vertices = np.frombuffer(body, np.dtype([("xyz", "<f4", 3), ("rgb", "u1", 3)]))
    known = np.isfinite(range_m)
    np.testing.assert_array_equal(vertices["xyz"], (rays * range_m[..., None])[known])
    np.testing.assert_array_equal(vertices["rgb"], (rgb >> (0 if dtype == np.uint8 else 8))[known])


def test_no_temporary_file_is_left_and_failure_keeps_the_old(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_atomic(tmp_path / "a" / "b.txt", b"old")

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "replace", full)
    with pytest.raises(OutputError, match=r"b\.txt: cannot be written: No space left"):
        write_atomic(tmp_path / "a" / "b.txt", b"new")
    assert [p.name for p in (tmp_path / "a").iterdir()] == ["b.txt"]
    assert (tmp_path / "a" / "b.txt").read_bytes() == b"old"


def test_keys_tell_parts_apart() -> None:
    assert content_key("ab", "c") != content_key("a", "bc")
    assert content_key(b"x", {"a": 1, "b": 2}) == content_key(b"x", {"b": 2, "a": 1})


def some_water(seed: int) -> Water:
    values = np.random.default_rng(seed).uniform(0, 1, (9, 3))
    return Water(
        *values, standard_errors={"beta": np.array([0.1, np.nan, 0.2])}, warnings=("little relief",)
    )


def test_water_comes_back_and_serves_other_frames(tmp_path: Path) -> None:
    water = some_water(1)
    (tmp_path / "water.json").write_bytes(b"".join(waters_content({"a": water, "b": water})))
    json.loads((tmp_path / "water.json").read_text(), parse_constant=pytest.fail)
    back = read_waters(tmp_path / "water.json", ["c"])["c"]
    np.testing.assert_array_equal(back.white, water.white)
    np.testing.assert_array_equal(back.standard_errors["beta"], water.standard_errors["beta"])
    assert back.warnings == water.warnings


def test_waters_of_single_frames_serve_only_those(tmp_path: Path) -> None:
    path = tmp_path / "water.json"
    path.write_bytes(b"".join(waters_content({"a": some_water(1), "b": some_water(2)})))
    np.testing.assert_array_equal(read_waters(path, ["b"])["b"].x, some_water(2).x)
    with pytest.raises(InputError, match=r"none for 'c': fit them with color\.lock=survey"):
        read_waters(path, ["c"])


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("{", "is not JSON"),
        ("{}", "is not a stereo-seecolor/water version 1"),
        ('{"format": "stereo-seecolor/water", "version": 1, "water": {"beta": 3}}', "is damaged"),
        ('{"format": "stereo-seecolor/water", "version": 1, "water": 5}', "is damaged"),
    ],
)
def test_files_that_hold_no_water(tmp_path: Path, content: str, message: str) -> None:
    (tmp_path / "water.json").write_text(content)
    with pytest.raises(InputError, match=message):
        read_waters(tmp_path / "water.json", ["a"])


def test_water_file_missing(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"water\.json: cannot be read"):
        read_waters(tmp_path / "water.json", ["a"])


def test_summary_counts_problems() -> None:
    rows = (
        FrameRow("a", warnings=("dark",), seconds={"match": 2.0}, facts={"coverage": 0.5}),
        FrameRow("b", warnings=("dark",), seconds={"match": 1.0, "read": 9.0}),
        FrameRow("c", status="failed", error="/x/c.png: is truncated"),
    )
    summary = RunSummary(rows)
    assert not summary.all_done
    assert summary.problems() == [("dark", 2, "a"), ("is truncated", 1, "c")]
    assert summary.stage_seconds() == {"read": 9.0, "match": 3.0}
    table = b"".join(frames_csv(rows)).decode().splitlines()
    assert (
        table[0] == "name,status,kept,left,right,timestamp_s,error,warnings,coverage,match_s,read_s"
    )
    assert table[3].startswith("c,failed,0,,,,/x/c.png: is truncated,")


def test_problems_that_differ_in_numbers_are_one() -> None:
    rows = (
        FrameRow("a1", status="failed", error="a1: left and right look swapped: 5% match"),
        FrameRow("b2", status="failed", error="b2: left and right look swapped: 12.5% match"),
        FrameRow("c3", status="failed", error="/x/c 3.png: is truncated"),
    )
    assert RunSummary(rows).problems() == [
        ("left and right look swapped: 5% match", 2, "a1"),
        ("is truncated", 1, "c3"),
    ]


def test_rows_of_two_passes_become_one() -> None:
    first = FrameRow(
        "a",
        left="l",
        timestamp_s=1.0,
        warnings=("dim",),
        kept=True,
        seconds={"read": 1.0},
        facts={"coverage": 1.0},
    )
    row = first.then(FrameRow("a", warnings=("dim", "red"), seconds={"read": 1.0, "color": 2.0}))
    assert row.warnings == ("dim", "red")
    assert row.seconds == {"read": 2.0, "color": 2.0}
    assert (row.left, row.timestamp_s, row.kept, row.facts) == ("l", 1.0, False, {"coverage": 1.0})


def test_table_joins_what_the_stages_say_of_a_pair() -> None:
    table = FrameTable()
    for i in range(3):
        table.add(
            FrameRow(f"{i}", left=f"L/{i}.png", seconds={"read": 1.0}, facts={"coverage": 0.5})
        )
    table.add(FrameRow("1", left="L/1.png", status="failed", error="gone", seconds={"color": 2.0}))
    assert [row.name for row in table.rows] == ["0", "1", "2"]
    assert (table.rows[1].status, table.rows[1].facts) == ("failed", {"coverage": 0.5})
    assert table.rows[1].seconds == {"read": 1.0, "color": 2.0}


def test_a_jpeg_that_is_cut_short_is_not_read(tmp_path: Path) -> None:
    content = encode_image(RNG.integers(0, 255, (64, 64, 3), dtype=np.uint8), "jpg")
    (tmp_path / "a.jpg").write_bytes(content[: len(content) // 2])
    with pytest.raises(InputError, match=r"a\.jpg: is truncated"):
        read_array(tmp_path / "a.jpg")


@pytest.mark.parametrize("deflate", [False, True])
def test_a_map_is_read_as_it_was_written_or_not_at_all(tmp_path: Path, deflate: bool) -> None:
    values = np.where(RNG.random((37, 51)) < 0.1, np.nan, RNG.random((37, 51))).astype(np.float32)
    content, path = encode_map(values, deflate), tmp_path / "a.tiff"
    path.write_bytes(content)
    np.testing.assert_array_equal(read_array(path), values)
    for size in (0, 10, 60, len(content) // 2, len(content) - 13):
        path.write_bytes(content[:size])
        with pytest.raises(InputError, match=r"a\.tiff: is damaged"):
            read_array(path)


@pytest.mark.parametrize("order", ["<", ">"])
def test_a_tiff_in_the_byte_order_of_its_camera_is_read_in_its_size(
    tmp_path: Path, order: str
) -> None:
    exif = Image.Exif()
    exif.endian = order
    exif[ExifTags.Base.Make] = "Reef"
    image, path = RNG.integers(0, 255, (37, 51, 3), dtype=np.uint8), tmp_path / "a.tiff"
    path.write_bytes(encode_tiff(image, exif.tobytes().removeprefix(EXIF_PREFIX)))
    np.testing.assert_array_equal(read_array(path, (51, 37)), image)


def test_own_pngs_are_read_as_opencv_reads_them() -> None:
    noise = RNG.integers(0, 255, (37, 51, 3), dtype=np.uint8)
    for content in (
        encode_image(noise, "png"),
        encode_image(np.repeat(noise[..., :1], 3, axis=2), "png"),
        encode_codes(noise[..., 0] // 64),
    ):
        found, expected = (
            quickly_decoded(content),
            cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_UNCHANGED),
        )
        assert found is not None
        assert found.dtype == expected.dtype
        np.testing.assert_array_equal(
            found, expected[..., ::-1] if expected.ndim == 3 else expected
        )
        assert all(
            quickly_decoded(content[:size]) is None
            for size in (0, 10, 60, len(content) // 2, len(content) - 13)
        )
        wrong = bytearray(content)
        wrong[len(content) // 2] ^= 255
        again = quickly_decoded(bytes(wrong))
        assert again is None or np.array_equal(again, found)


def test_pngs_of_other_programs_are_read_as_opencv_reads_them() -> None:
    smooth = cv2.resize(RNG.integers(0, 255, (5, 7, 3), dtype=np.uint8), (51, 37))
    for pixels in (smooth, smooth[..., 0]):
        file = io.BytesIO()
        Image.fromarray(pixels).save(file, "PNG")  # all five filters, row by row
        for strategy in range(5):
            content = cv2.imencode(".png", pixels, [cv2.IMWRITE_PNG_STRATEGY, strategy])[
                1
            ].tobytes()
            np.testing.assert_array_equal(
                quickly_decoded(content), pixels[..., ::-1] if pixels.ndim == 3 else pixels
            )
        np.testing.assert_array_equal(quickly_decoded(file.getvalue()), pixels)


@pytest.mark.parametrize("kind", range(5))
def test_every_filter_of_png_is_undone(kind: int) -> None:
    pixels = RNG.integers(0, 255, (9, 11, 3), dtype=np.uint8)
    rows = np.zeros((9, 34), np.uint8)
    rows[:, 0], rows[:, 1:] = kind, pixels.reshape(9, 33)
    content = _file(pixels, zlib.compress(rows.tobytes()), {})
    np.testing.assert_array_equal(quickly_decoded(content), decoded(content)[..., ::-1])


def test_other_files_are_left_to_opencv() -> None:
    noise = RNG.integers(0, 255, (37, 51, 4), dtype=np.uint8)
    for content in (cv2.imencode(".png", noise)[1], cv2.imencode(".tiff", noise[..., 0])[1]):
        assert quickly_decoded(content.tobytes()) is None
    assert quickly_decoded(encode_image(noise[..., :3].astype(np.uint16), "png")) is None


def test_a_png_that_inflates_to_more_than_its_pixels_is_not_inflated() -> None:
    content = _file(np.zeros((9, 11, 3), np.uint8), zlib.compress(bytes(50_000_000), 1), {})
    tracemalloc.start()
    try:
        assert quickly_decoded(content) is None
        assert tracemalloc.get_traced_memory()[1] < 5_000_000
    finally:
        tracemalloc.stop()


def test_rows_of_a_long_dive_are_as_they_were_added_whatever_comes_when() -> None:
    number = 2 * packed.CHUNK + 7
    table = FrameTable()
    for k in range(number):
        table.add(
            FrameRow(f"{k}", left=f"l/{k}", hashes={"left": f"{k:064x}"}, seconds={"match": 0.5})
        )
    for k in (*range(number), 3, packed.CHUNK):
        table.add(FrameRow(f"{k}", left=f"l/{k}", seconds={"color": 1.0}))
    rows = table.rows
    assert len(rows) == number
    assert [row.name for row in rows] == [f"{k}" for k in range(number)]
    assert [rows[k].seconds["color"] for k in (0, 3, packed.CHUNK, number - 1)] == [
        1.0,
        2.0,
        2.0,
        1.0,
    ]
    assert all(row.seconds["match"] == 0.5 for row in rows)
    assert rows[-1].hashes == {"left": f"{number - 1:064x}"}
