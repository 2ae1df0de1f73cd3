"""What a map tells of its frames: residuals of given poses in frames.csv, the place on Earth in
each picture's EXIF.
"""

import csv
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from mapping_scene import flat_frames, write_map
from PIL import ExifTags, Image

from stereo_seecolor.commands.described_frames import describe_frames, gps_tags, with_gps
from stereo_seecolor.earth import north_east_from_degrees
from stereo_seecolor.files.decode import read_array
from stereo_seecolor.files.encode import ImageFormat, encode_image
from stereo_seecolor.files.image_headers import exif_block, image_size
from stereo_seecolor.inputs.capture import read_capture
from stereo_seecolor.records import FrameRow, GeoOrigin
from stereo_seecolor.run_folder.finished_map import TrackPoint
from stereo_seecolor.run_folder.finished_run import open_run
from stereo_seecolor.run_folder.folder import RunFolder
from stereo_seecolor.run_folder.frames_csv import frames_csv, with_residuals

ORIGIN = GeoOrigin(-33.123456, -151.2)
SUFFIX: dict[ImageFormat, str] = {"png": ".png", "jpg": ".jpg", "tiff": ".tiff", "tiff32": ".tiff"}


def point(name: str = "f0", residual_m: float | None = None) -> TrackPoint:
    return TrackPoint(name, None, 123.456, -78.9, -12.34, residual_m, residual_m)


@pytest.mark.parametrize("image_format", SUFFIX)
def test_a_position_is_written_and_pixels_and_other_tags_stay(
    image_format: ImageFormat, tmp_path: Path
) -> None:
    exif = Image.Exif()
    exif[ExifTags.Base.Make] = "Reef"
    exif.get_ifd(ExifTags.IFD.Exif)[ExifTags.Base.ExposureTime] = 0.004
    exif.get_ifd(ExifTags.IFD.GPSInfo).update({1: "N", 2: (1.0, 2.0, 3.0)})
    kind = np.float32 if image_format == "tiff32" else np.uint8
    picture = np.random.default_rng(0).uniform(0, 255, (24, 31, 3)).astype(kind)
    before = tmp_path / f"before{SUFFIX[image_format]}"
    before.write_bytes(encode_image(picture, image_format, exif.tobytes()[6:]))
    after = tmp_path / f"after{SUFFIX[image_format]}"
    after.write_bytes(with_gps(before.read_bytes(), gps_tags(point(), ORIGIN)))
    assert np.array_equal(read_array(before), read_array(after))
    assert image_size(after.read_bytes()) == (31, 24)
    capture = read_capture(after.read_bytes())
    assert capture.exposure_s == 0.004
    assert capture.latitude_deg is not None and capture.longitude_deg is not None
    north_m, east_m = north_east_from_degrees(capture.latitude_deg, capture.longitude_deg, ORIGIN)
    assert (north_m, east_m) == pytest.approx((-78.9, 123.456), abs=0.002)
    stored = Image.Exif()
    stored.load(b"Exif\x00\x00" + exif_block(after.read_bytes()))
    gps = stored.get_ifd(ExifTags.IFD.GPSInfo)
    assert (
        float(gps[ExifTags.GPS.GPSAltitude]) == 12.34
        and gps[ExifTags.GPS.GPSAltitudeRef] == b"\x01"
    )
    assert stored[ExifTags.Base.Make] == "Reef"
    assert with_gps(after.read_bytes(), gps_tags(point(), ORIGIN)) == after.read_bytes(), (
        "a second time changes nothing"
    )
    unknown = gps_tags(point(), replace(ORIGIN, depth_known=False))
    assert ExifTags.GPS.GPSLatitude in unknown and ExifTags.GPS.GPSAltitude not in unknown


def test_a_picture_without_exif_gets_a_position() -> None:
    content = encode_image(np.zeros((8, 9, 3), np.uint8), "jpg")
    assert read_capture(with_gps(content, gps_tags(point(), ORIGIN))).latitude_deg == pytest.approx(
        -33.124167, abs=1e-6
    )


@pytest.mark.slow
def test_frames_of_a_map_on_earth_hold_their_place(tmp_path: Path) -> None:
    out = write_map(tmp_path / "out", flat_frames(4), "prior")
    before = [frame.read("corrected") for frame in open_run(out).frames]
    assert exif_block((out / "corrected" / "f0.png").read_bytes()) == b"", (
        "a map of its own coordinates tells no place"
    )
    description = json.loads((out / "map" / "map.json").read_bytes())
    description["origin"] = {
        "latitude_deg": ORIGIN.latitude_deg,
        "longitude_deg": ORIGIN.longitude_deg,
    }
    (out / "map" / "map.json").write_text(json.dumps(description))
    with RunFolder.existing(out, "fuse") as folder:
        describe_frames(folder)
        assert folder.frames.finished("corrected", "f2", "key"), "the manifest knows the new files"
    with (out / "map" / "poses.csv").open() as file:
        placed = {
            row["name"]: (float(row["y_m"]), float(row["x_m"])) for row in csv.DictReader(file)
        }
    for frame, pixels in zip(open_run(out).frames, before, strict=True):
        assert np.array_equal(frame.read("corrected"), pixels)
        capture = read_capture(frame.products["corrected"].read_bytes())
        assert capture.latitude_deg is not None and capture.longitude_deg is not None
        found = north_east_from_degrees(capture.latitude_deg, capture.longitude_deg, ORIGIN)
        assert tuple(found) == pytest.approx(placed[frame.name], abs=0.002)


def test_residuals_are_columns_of_frames_csv_while_there_are_any() -> None:
    table = b"".join(
        frames_csv([FrameRow("f0", error="a, b"), FrameRow("f1", facts={"coverage": 0.5})])
    )
    with_both = with_residuals(table, [point("f0", 0.25)])
    rows = list(csv.DictReader(with_both.decode().splitlines()))
    assert [row["position_residual_m"] for row in rows] == ["0.2500", ""]
    assert [row["attitude_residual_deg"] for row in rows] == ["0.2500", ""]
    assert with_residuals(with_both, [point("f0", 0.25)]) == with_both
    assert with_residuals(with_both, []) == with_residuals(with_both, [point("f0")]) == table
