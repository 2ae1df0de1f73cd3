"""Images, cameras and depths for Nerfstudio."""

import json
import shutil
from pathlib import Path

import numpy as np

from stereo_seecolor.extras.export.export_format import ExportFormat
from stereo_seecolor.extras.export.images_of_8_bits import write_images
from stereo_seecolor.files.png import encode_png
from stereo_seecolor.run_folder.finished_run import FinishedFrame
from stereo_seecolor.run_folder.layout import CLOUD
from stereo_seecolor.run_folder.posed_run import PosedRun

OPENGL_FROM_OPENCV = np.diag([1.0, -1.0, -1.0, 1.0])
METERS_PER_UNIT = 0.001
"""Of the depth maps: 16-bit millimeters, which is what Nerfstudio takes unless told otherwise."""


def write_nerfstudio(posed: PosedRun, folder: Path) -> None:
    """Write transforms.json, ``images/``, ``depth/`` (along the optical axis; 0 unknown) and
    points.ply.

    Poses are camera to world in OpenGL's axes: x right, y up, z backward (Nerfstudio, "Data
    conventions").
    """
    (folder / "depth").mkdir()
    g, images = posed.geometry, write_images(posed.frames, folder)
    shutil.copyfile(posed.map_folder / CLOUD, folder / "points.ply")
    content = {
        "camera_model": "OPENCV",
        **{"w": g.image_size[0], "h": g.image_size[1], "fl_x": g.focal_px, "fl_y": g.focal_px},
        **dict(zip(("cx", "cy"), posed.principal_point_px, strict=True)),
        **{"k1": 0.0, "k2": 0.0, "p1": 0.0, "p2": 0.0},
        "ply_file_path": "points.ply",
        "depth_unit_scale_factor": METERS_PER_UNIT,
        "frames": [
            {
                "file_path": f"images/{image.name}",
                "depth_file_path": f"depth/{_write_depth(posed, frame, folder / 'depth')}",
                "transform_matrix": (T @ OPENGL_FROM_OPENCV).tolist(),
            }
            for frame, image, T in zip(posed.frames, images, posed.T_map_camera, strict=True)
        ],
    }
    (folder / "transforms.json").write_text(json.dumps(content, indent=1), encoding="utf-8")


def _write_depth(posed: PosedRun, frame: FinishedFrame, folder: Path) -> str:
    """Depths as a 16-bit PNG, 0 where they are unknown or beyond 65.535 m."""
    name = f"{frame.name}.png"
    depth_m = posed.geometry.depth_from_range(posed.measured_range_m(frame))
    depth = np.round(1 / METERS_PER_UNIT * np.nan_to_num(depth_m))
    depth = np.where(depth <= np.iinfo(np.uint16).max, depth, 0).astype(np.uint16)
    (folder / name).write_bytes(encode_png(depth))
    return name


NERFSTUDIO = ExportFormat(
    "images, transforms.json, depth maps, points.ply", "Nerfstudio, Instant-NGP", write_nerfstudio
)
