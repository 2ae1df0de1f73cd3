"""Range maps of other programs are read by their content, in their units, and refused or named
where they are no meters.
"""

import io
import re
import tempfile
import tracemalloc
import warnings
import zipfile
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import cv2
import h5py
import numpy as np
import OpenEXR
import pytest
import rasterio
import scipy.io
from PIL import Image
from rasterio.errors import NotGeoreferencedWarning

from stereo_seecolor.checks.fitted_water import range_scale_notes
from stereo_seecolor.color import Water, fit
from stereo_seecolor.commands.run import correct
from stereo_seecolor.errors import InputError
from stereo_seecolor.extras.synthetic.waters import WaterName, lit_water
from stereo_seecolor.files.srgb import encode_srgb
from stereo_seecolor.files.tiff import encode_tiff
from stereo_seecolor.inputs.images import read_range_map
from stereo_seecolor.inputs.pairing import pair_by_stem

RANGE_M = np.random.default_rng(0).uniform(1.2, 3.4, (24, 32)).astype(np.float32)
RANGE_M[3:7, 5:9] = np.nan
MILLIMETERS = np.nan_to_num(np.round(RANGE_M * 1000))


def image_file(suffix: str, values: np.ndarray) -> bytes:
    return cv2.imencode(suffix, values)[1].tobytes()


def pfm(values: np.ndarray, order: str = "<") -> bytes:
    kind = "Pf" if values.ndim == 2 else "PF"
    head = (
        f"{kind}\n{values.shape[1]} {values.shape[0]}\n{'-' if order == '<' else ''}0.5\n".encode()
    )
    return head + values[::-1].astype(f"{order}f4").tobytes()


def exr(channels: dict[str, np.ndarray]) -> bytes:
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    with OpenEXR.File(header, channels) as file, tempfile.TemporaryDirectory() as folder:
        file.write(f"{folder}/a.exr")
        return Path(folder, "a.exr").read_bytes()


def saved(save: Callable[..., None], *values: object, **named: object) -> bytes:
    stream = io.BytesIO()
    save(stream, *values, **named)
    return stream.getvalue()


def mat73(values: np.ndarray) -> bytes:
    stream = io.BytesIO()
    with h5py.File(stream, "w", userblock_size=512) as file:
        file["range"] = values.T
    content = stream.getvalue()
    return b"MATLAB 7.3 MAT-file".ljust(512, b"\0") + content[512:]


def gdal_tiff(values: np.ndarray, unknown: float, **how: object) -> bytes:
    with rasterio.MemoryFile() as memory:
        shape = {
            "width": values.shape[1],
            "height": values.shape[0],
            "count": 1,
            "dtype": values.dtype,
        }
        with memory.open(
            driver="GTiff", nodata=unknown, transform=rasterio.Affine.scale(2), **shape, **how
        ) as file:
            file.write(values, 1)
        return bytes(memory.read())


KINDS = {
    "half float.tif": lambda: encode_tiff(RANGE_M.astype(np.float16)),
    "double.tif": lambda: image_file(".tiff", RANGE_M.astype(np.float64)),
    "int16.tif": lambda: gdal_tiff(
        np.where(MILLIMETERS > 0, MILLIMETERS, 32000).astype(np.int16), 32000
    ),
    "uint32.tif": lambda: gdal_tiff(MILLIMETERS.astype(np.uint32), 0),
    "big.tif": lambda: gdal_tiff(RANGE_M, np.nan, BIGTIFF="YES", compress="zstd"),
    "zstd.tif": lambda: gdal_tiff(RANGE_M, np.nan, compress="zstd"),
    "u16.png": lambda: image_file(".png", MILLIMETERS.astype(np.uint16)),
    "u16 with a mark.png": lambda: image_file(
        ".png", np.where(MILLIMETERS > 0, MILLIMETERS, 65535).astype(np.uint16)
    ),
    "little.pfm": lambda: pfm(RANGE_M),
    "big.pfm": lambda: pfm(RANGE_M, ">"),
    "float.exr": lambda: exr({"Z": RANGE_M}),
    "half.exr": lambda: exr({"Y": RANGE_M.astype(np.float16)}),
    "named.exr": lambda: exr({"R": RANGE_M * 0, "G": RANGE_M * 0, "ViewLayer.Depth.Z": RANGE_M}),
    "float.npy": lambda: saved(np.save, RANGE_M),
    "int.npy": lambda: saved(np.save, MILLIMETERS.astype(np.int64)),
    "one.npy": lambda: saved(np.save, RANGE_M[..., None]),
    "one.npz": lambda: saved(np.savez_compressed, RANGE_M),
    "named.npz": lambda: saved(
        np.savez, K=np.eye(3), mask=RANGE_M > 0, confidence=RANGE_M * 0, depth=RANGE_M
    ),
    "a.mat": lambda: saved(
        scipy.io.savemat, {"range": RANGE_M.astype(np.float64), "K": np.eye(3)}, do_compression=True
    ),
    "7.3.mat": lambda: mat73(RANGE_M),
    "gray in color.png": lambda: image_file(".png", np.dstack([MILLIMETERS.astype(np.uint16)] * 3)),
    "gray and alpha.png": lambda: image_file(
        ".png", np.dstack([*[MILLIMETERS.astype(np.uint16)] * 3, np.full((24, 32), 65535, "u2")])
    ),
    "gray in color.tiff": lambda: image_file(".tiff", np.dstack([RANGE_M] * 3)),
    "gray in color.exr": lambda: exr({"R": RANGE_M, "G": RANGE_M, "B": RANGE_M}),
    "gray in color.pfm": lambda: pfm(np.dstack([RANGE_M] * 3)),
}


@pytest.mark.parametrize("name", KINDS)
def test_kinds_of_range_maps(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_bytes(KINDS[name]())
    np.testing.assert_allclose(read_range_map(tmp_path / name), RANGE_M, atol=0.0011)


@pytest.mark.parametrize(
    ("units_per_m", "values"),
    [(5000, np.uint16), (256, np.uint16), (100, np.float32), (50, np.uint8)],
)
def test_units_are_set(tmp_path: Path, units_per_m: float, values: type) -> None:
    stored = np.nan_to_num(np.round(RANGE_M * units_per_m)).astype(values)
    path = tmp_path / "a.tiff"
    path.write_bytes(image_file(".tiff", stored))
    np.testing.assert_allclose(read_range_map(path, units_per_m), RANGE_M, atol=0.6 / units_per_m)


def normalized(top: float) -> np.ndarray:
    return top * (RANGE_M - np.nanmin(RANGE_M)) / np.nanmax(RANGE_M - np.nanmin(RANGE_M))


REFUSED = {
    "a.png": (
        lambda: image_file(".png", np.nan_to_num(normalized(65535)).astype(np.uint16)),
        "a map without scale",
    ),
    "b.tiff": (
        lambda: image_file(".tiff", normalized(1).astype(np.float32)),
        "its values end at 1, .* a map without scale",
    ),
    "c.tiff": (
        lambda: image_file(".tiff", RANGE_M * 1000),
        "read as meters, an impossible range under water: set input.range_units",
    ),
    "d.png": (
        lambda: image_file(".png", np.nan_to_num(RANGE_M * 8).astype(np.uint16)),
        "its median is 0.0.* read as millimeters",
    ),
    "e.png": (
        lambda: image_file(".png", np.uint8(np.nan_to_num(normalized(255)))),
        r"8-bit maps, .*\(near is bright",
    ),
    "f.npz": (
        lambda: saved(np.savez, left=RANGE_M, right=RANGE_M),
        r"several maps \(left, right\)",
    ),
    "g.npy": (lambda: saved(np.save, np.dstack([RANGE_M, RANGE_M * 2, RANGE_M])), "has 3 channels"),
    "h.npy": (lambda: saved(np.save, np.array([{}])), "Python objects"),
    "i.pfm": (lambda: pfm(RANGE_M)[:-9], "truncated or damaged"),
    "j.exr": (lambda: exr({"Z": RANGE_M})[:90], "is damaged"),
    "k.npy": (lambda: saved(np.save, -RANGE_M), "only negative values"),
    "l.npz": (lambda: saved(np.savez, K=np.eye(3)), "no map, but K"),
}


def test_many_threads_leave_the_filters_of_warnings(tmp_path: Path) -> None:
    """GDAL warns of each map without a position; who restores filters of another thread shows or
    hides warnings of the whole process.
    """
    path = tmp_path / "map.tiff"
    Image.fromarray(RANGE_M).save(path, tiffinfo={42113: "-1"})  # only GDAL knows this tag
    with warnings.catch_warnings(record=True) as shown, ThreadPoolExecutor(8) as threads:
        warnings.simplefilter("always")
        inside = list(warnings.filters)
        list(threads.map(read_range_map, [path] * 400))
        after = list(warnings.filters)
    assert not shown
    # libraries that another thread imports at this time may add filters of their own
    added = [each for each in after if each not in inside]
    assert [each for each in after if each in inside] == inside
    assert not any(each[2] is NotGeoreferencedWarning for each in added)


@pytest.mark.parametrize("name", REFUSED)
def test_what_holds_no_ranges_in_meters_is_refused(tmp_path: Path, name: str) -> None:
    make, message = REFUSED[name]
    (tmp_path / name).write_bytes(make())
    with pytest.raises(InputError, match=message) as caught:
        read_range_map(tmp_path / name)
    assert "\n" not in str(caught.value)


def test_values_beyond_any_range_are_unknown(tmp_path: Path) -> None:
    path = tmp_path / "a.npy"
    np.save(path, np.where(np.isfinite(RANGE_M), RANGE_M, np.float32(1e10)))
    np.testing.assert_array_equal(read_range_map(path), RANGE_M)


def test_a_folder_of_another_kind_names_it(tmp_path: Path) -> None:
    for name in ("images/1.png", "range/1.bin", "range/2.bin", "range/notes.txt"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()
    with pytest.raises(InputError, match=r"2 files of another kind \(.bin\): save them as .npy"):
        pair_by_stem(tmp_path / "images", tmp_path / "range")


def test_exchanged_images_and_range_maps_are_named(tmp_path: Path) -> None:
    ranges, images = tmp_path / "ranges", tmp_path / "images"
    for path, values in (
        (ranges / "1.tiff", RANGE_M),
        (images / "1.png", np.zeros((24, 32, 3), np.uint8)),
    ):
        path.parent.mkdir()
        path.write_bytes(image_file(path.suffix, values))
    with pytest.raises(InputError, match="if these are range maps, exchange --images and --range"):
        correct(ranges, images, tmp_path / "out")


def test_two_maps_of_one_name_are_named(tmp_path: Path) -> None:
    for name in ("images/1.png", "range/1.png", "range/1.tiff"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()
    with pytest.raises(
        InputError,
        match=r"several files are called '1' \(1.png, 1.tiff\): .* pattern such as 'range/\*.tiff'",
    ):
        pair_by_stem(tmp_path / "images", tmp_path / "range")


def test_arrays_are_paired_with_images(tmp_path: Path) -> None:
    for name in ("images/1.png", "images/2.png", "range/1.npy", "range/2.mat"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()
    assert [
        pair.right.name for pair in pair_by_stem(tmp_path / "images", tmp_path / "range").pairs
    ] == ["1.npy", "2.mat"]


def fitted(
    water: WaterName, ranges: Callable[[np.ndarray], np.ndarray], gray: bool = False, ways: int = 1
) -> dict[str, Water]:
    """Waters fitted to drawn frames of a slope, with the ranges that ``ranges`` makes of the true
    ones. ways: how often the light crosses the range, 2 for lamps on the rig, whose fall-off is
    taken out.
    """
    depth_m = 8 if ways == 1 else 0
    true = lit_water(water, depth_m, max(depth_m - 2, 0), exposure_range_m=3).water
    found = {}
    for seed in range(3):
        random = np.random.default_rng(seed)
        range_m = np.linspace(1.5, 5, 96)[:, None] + random.uniform(0, 0.5, (96, 128))
        reflectance = np.clip(
            random.lognormal(-1.6, 0.7, (96, 128, 1)) * random.uniform(0.8, 1.25, (96, 128, 3)),
            0,
            1,
        )
        left = true.white * true.attenuation(range_m) ** ways
        light = reflectance * left + true.backscatter(range_m)
        image = np.round(
            255 * encode_srgb(np.clip(light[..., 1:2].repeat(3, 2) if gray else light, 0, 1))
        ).astype(np.uint8)
        water_of = fit(image, ranges(range_m).astype(np.float32))
        found[str(seed)] = replace(water_of, fall_off=2.0 * (ways - 1))
    return found


@pytest.mark.slow
@pytest.mark.parametrize("ways", [1, 2])
def test_lamps_cross_the_water_twice(ways: int) -> None:
    true, short = (
        fitted("blue-ocean", lambda range_m, by=by: range_m / by, ways=ways) for by in (1, 5)
    )
    assert range_scale_notes(true, given=True) == ()
    (note,) = range_scale_notes(short, given=True)
    assert "ranges are too short" in note


@pytest.mark.parametrize(("fall_off", "scale", "doubted"), [(0, 1, 1), (2, 1, 0), (2, 0.5, 1)])
def test_the_bound_of_lamps_is_that_of_two_ways(
    fall_off: float, scale: float, doubted: int
) -> None:
    """Pure water takes 0.6 / m more of red than of green from the light of lamps."""
    zero, white = np.zeros(3), np.array([0.3, 0.6, 0.5])
    y = np.array([0.7, 0.1, 0.06]) / scale
    water = Water(zero + 0.01, zero + 0.3, zero, zero + 1, zero, zero, y, zero, white)
    lit = replace(water, fall_off=fall_off, typical_range_m=2.0)
    assert len(range_scale_notes({"1": lit}, given=True)) == doubted
    flat = replace(lit, warnings=("little relief, 2.00 to 2.00 m: attenuation is the prior's",))
    assert range_scale_notes({"1": flat}, given=True) == ()


@pytest.mark.parametrize(("std", "doubted"), [(0.005, True), (0.1, False)])
def test_little_red_counts_only_where_a_fit_knows_it(std: float, doubted: bool) -> None:
    zero, white = np.zeros(3), np.array([0.3, 0.6, 0.5])
    water = Water(
        zero + 0.01, zero + 0.3, *np.zeros((4, 3)), np.array([0.08, 0.04, 0.02]), zero, white
    )
    known = replace(water, typical_range_m=2.0, standard_errors={"y": zero + std, "w": zero})
    notes = range_scale_notes({"1": known}, given=True)
    assert len(notes) == doubted
    for note in notes:
        assert "ranges are too long" in note and "the images were taken in air" in note


def test_an_unknown_standard_error_hides_no_known_one() -> None:
    """As of gray images, whose fit states one part of it alone."""
    zero, white = np.zeros(3), np.array([0.3, 0.6, 0.5])
    water = Water(
        zero + 0.01, zero + 0.3, *np.zeros((4, 3)), np.array([0.09, 0.06, 0.04]), zero, white
    )
    known = replace(
        water, typical_range_m=2.0, standard_errors={"y": zero + 0.1, "w": zero + np.nan}
    )
    assert range_scale_notes({"1": known}, given=True) == ()


@pytest.mark.slow
@pytest.mark.parametrize("water", ["blue-ocean", "coastal-green", "turbid"])
def test_ranges_in_meters_are_not_doubted(water: WaterName) -> None:
    for given in (False, True):
        assert range_scale_notes(fitted(water, lambda range_m: range_m), given) == ()
        assert range_scale_notes(fitted(water, lambda range_m: range_m, gray=True), given) == ()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("ranges", "found"),
    [
        (lambda range_m: 5 * range_m, "ranges are too long"),
        (lambda range_m: 60 / range_m, "near and far are exchanged in the range maps"),
        (lambda range_m: 0.2 * range_m, "ranges are too short"),
    ],
)
def test_water_tells_ranges_that_are_no_meters(
    ranges: Callable[[np.ndarray], np.ndarray], found: str
) -> None:
    (note,) = range_scale_notes(fitted("blue-ocean", ranges), given=True)
    assert re.search(found, note), note


def test_an_exr_is_refused_by_its_header(tmp_path: Path) -> None:
    content = bytearray(exr({"Z": RANGE_M}))
    at = content.index(b"dataWindow\0box2i\0") + len(b"dataWindow\0box2i\0") + 4
    content[at : at + 16] = np.array([0, 0, 99_999, 99_999], "<i4").tobytes()
    (tmp_path / "a.exr").write_bytes(content)
    with pytest.raises(InputError, match=r"a.exr: claims 100000x100000 pixels"):
        read_range_map(tmp_path / "a.exr")


@pytest.mark.slow
def test_an_npz_is_refused_by_what_its_directory_states(tmp_path: Path) -> None:
    """A megabyte of zeros was unpacked to gigabytes."""
    zeros = bytes(1 << 20)
    with (
        zipfile.ZipFile(tmp_path / "a.npz", "w", zipfile.ZIP_DEFLATED) as archive,
        archive.open("range_m.npy", "w", force_zip64=True) as member,
    ):
        for _ in range(1200):
            member.write(zeros)
    tracemalloc.start()
    with pytest.raises(InputError, match=r"a.npz: .*holds more than 1144 MB: not read"):
        read_range_map(tmp_path / "a.npz")
    assert tracemalloc.get_traced_memory()[1] < 50 << 20
    tracemalloc.stop()
