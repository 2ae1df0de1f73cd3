"""Writes what a map shows of its frames into their files: residuals, positions on Earth."""

import numpy as np
from PIL import ExifTags, Image
from PIL.TiffImagePlugin import IFDRational

from stereo_seecolor.earth import degrees_from_north_east
from stereo_seecolor.files.exif_blocks import with_exif
from stereo_seecolor.files.image_headers import EXIF_PREFIX, exif_block
from stereo_seecolor.records import GeoOrigin
from stereo_seecolor.run_folder.finished_map import TrackPoint, open_map, track_points
from stereo_seecolor.run_folder.folder import RunFolder
from stereo_seecolor.run_folder.reports import renew_frames_table

PICTURES = ("corrected", "original/corrected")
"""Products with an EXIF position."""
SECOND = 100_000
"""Steps of an EXIF position in a second of arc: 0.3 mm of latitude each."""
BELOW_SEA_LEVEL = b"\x01"


def describe_frames(folder: RunFolder) -> None:
    """Write the residuals of poses into frames.csv, and the position into each picture's EXIF.
    Raises InputError, OutputError.
    """
    renew_frames_table(folder)
    made = open_map(folder.root)
    if made is None or made.origin is None:
        return
    for point in track_points(folder.root):
        record = folder.manifest.frame(point.name)
        if record is None or "corrected" not in record.stages:
            continue
        stage = folder.frames.finished("corrected", point.name, record.stages["corrected"].key)
        if stage is None:
            continue  # somebody changed a file of it
        changed = dict[str, bytes]()
        for product, path in stage.outputs.items():
            if product in PICTURES:
                content = (folder.root / path).read_bytes()
                described = with_gps(content, gps_tags(point, made.origin))
                if described != content:
                    changed[path] = described
        folder.frames.rewrite(record, changed)


def with_gps(content: bytes, gps: dict[int, object]) -> bytes:
    """The content of an image file with these GPS tags in place of its own."""
    exif, block = Image.Exif(), exif_block(content)
    if block:
        exif.load(EXIF_PREFIX + block)
    place = exif.get_ifd(ExifTags.IFD.GPSInfo)
    place.clear()
    place.update(gps)
    return with_exif(content, exif.tobytes().removeprefix(EXIF_PREFIX))


def gps_tags(point: TrackPoint, origin: GeoOrigin) -> dict[int, object]:
    """EXIF's GPS tags of a camera's position: WGS84, its depth, where known, as an altitude below
    zero.
    """
    latitude_deg, longitude_deg = degrees_from_north_east(point.y_m, point.x_m, origin)
    tags = ExifTags.GPS
    depth: dict[int, object] = {
        tags.GPSAltitudeRef: BELOW_SEA_LEVEL if point.z_m < 0 else b"\x00",
        tags.GPSAltitude: IFDRational(round(abs(point.z_m) * 1000), 1000),
    }
    return {
        tags.GPSVersionID: b"\x02\x03\x00\x00",
        tags.GPSLatitudeRef: "N" if latitude_deg >= 0 else "S",
        tags.GPSLatitude: _sexagesimal(latitude_deg),
        tags.GPSLongitudeRef: "E" if longitude_deg >= 0 else "W",
        tags.GPSLongitude: _sexagesimal(longitude_deg),
        **(depth if origin.depth_known else {}),
        tags.GPSMapDatum: "WGS-84",
    }


def _sexagesimal(degrees: float) -> tuple[IFDRational, IFDRational, IFDRational]:
    parts = round(float(np.abs(degrees)) * 3600 * SECOND)
    minutes, seconds = divmod(parts, 60 * SECOND)
    return IFDRational(minutes // 60, 1), IFDRational(minutes % 60, 1), IFDRational(seconds, SECOND)
