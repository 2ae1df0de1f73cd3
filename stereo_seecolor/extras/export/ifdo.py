"""iFDO 2.1, the metadata of a set of marine images (Schoening et al., Scientific Data 2022): for
PANGAEA, BIIGLE, FathomNet.
"""

import hashlib
import uuid
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from stereo_seecolor.earth import degrees_from_north_east
from stereo_seecolor.extras.export.export_format import ExportFormat
from stereo_seecolor.extras.export.images_of_8_bits import write_images
from stereo_seecolor.run_folder.finished_run import FinishedFrame
from stereo_seecolor.run_folder.posed_run import PosedRun
from stereo_seecolor.version import __version__

VERSION = "v2.1.0"
HANDLE = "unknown: add the handle or DOI after publication"


def write(posed: PosedRun, folder: Path) -> None:
    """``images/`` and image-set.ifdo.yaml. What the program cannot know (project, license,
    creators) is left out: add it.
    """
    images = write_images(posed.frames, folder)
    (folder / "image-set.ifdo.yaml").write_bytes(
        document(posed, images, folder / "images", "images")
    )


def document(posed: PosedRun, images: Sequence[Path], folder: Path, local_path: str) -> bytes:
    """The metadata alone. images: of the frames, which lie below a folder. local_path: that folder,
    as the document names it.
    """
    content: dict[str, Any] = {
        "image-set-header": _header(posed, local_path),
        "image-set-items": {},
    }
    for frame, image, T in zip(posed.frames, images, posed.T_map_camera, strict=True):
        content["image-set-items"][image.relative_to(folder).as_posix()] = _item(
            posed, frame, image, T
        )
    return yaml.safe_dump(content, sort_keys=False, allow_unicode=True).encode()


def _header(posed: PosedRun, local_path: str) -> dict[str, Any]:
    identity = "".join(frame.sha256 for frame in posed.frames)
    fields = {
        "image-set-name": posed.run.root.resolve().name,
        "image-set-uuid": str(uuid.uuid5(uuid.NAMESPACE_OID, identity)),
        "image-set-handle": HANDLE,
        "image-set-ifdo-version": VERSION,
        "image-set-local-path": local_path,
        "image-acquisition": "photo",
        "image-quality": "processed",
        "image-navigation": "reconstructed",
        "image-scale-reference": "3D camera",
        "image-abstract": "Frames of a stereo camera, their colors corrected for the water from "
        "measured ranges "
        f"(stereo-seecolor {__version__}).",
    }
    on_earth = {"image-coordinate-reference-system": "EPSG:4326"} if posed.origin else {}
    return {**fields, **on_earth, "image-camera-calibration-model": _camera(posed)}


def _camera(posed: PosedRun) -> dict[str, Any]:
    g = posed.geometry
    return {
        "calibration-model-type": "rectilinear water",
        "calibration-focal-length-xy-pixel": [g.focal_px, g.focal_px],
        "calibration-principal-point-xy-pixel": [g.cx_left_px, g.cy_px],
        "calibration-distortion-coefficients": [0.0, 0.0, 0.0, 0.0, 0.0],
        "calibration-approximate-field-of-view-water-xy-degree": [
            float(np.degrees(2 * np.arctan(side / (2 * g.focal_px)))) for side in g.image_size
        ],
    }


def _item(posed: PosedRun, frame: FinishedFrame, image: Path, T: np.ndarray) -> dict[str, Any]:
    item: dict[str, Any] = {
        "image-uuid": str(uuid.uuid5(uuid.NAMESPACE_OID, frame.sha256)),
        "image-hash-sha256": hashlib.sha256(image.read_bytes()).hexdigest(),
    }
    if frame.taken:
        item["image-datetime"] = frame.taken.strftime("%Y-%m-%d %H:%M:%S.%f")
    position_m = T[:3, 3] + posed.offset_m
    if posed.origin:
        latitude_deg, longitude_deg = degrees_from_north_east(
            float(position_m[1]), float(position_m[0]), posed.origin
        )
        item |= {"image-latitude": latitude_deg, "image-longitude": longitude_deg}
        if posed.origin.depth_known:
            item["image-altitude-meters"] = float(position_m[2])
    range_m = posed.measured_range_m(frame)
    known = np.isfinite(range_m)
    if known.any():
        item["image-meters-above-ground"] = float(
            np.median(posed.geometry.depth_from_range(range_m)[known])
        )
    return item


FORMAT = ExportFormat("images and their metadata, iFDO 2.1", "PANGAEA, BIIGLE, FathomNet", write)
