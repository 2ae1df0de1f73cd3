"""Cameras and points for KWIVER's tools (TeleSculptor, VIAME): a KRTD file for each image, and the map's cloud as PLY.

A KRTD file holds K (3, 3), R (3, 3) and t (3,) of x = K (R X + t), and the distortion; blank lines between them.
"""

import shutil
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from stereo_seecolor.export.images import write_image
from stereo_seecolor.export.posed_run import PosedRun
from stereo_seecolor.run_folder.layout import CLOUD


def write(posed: PosedRun, folder: Path) -> None:
    """``images/``, ``krtd/NAME.krtd``, image_list.txt and cloud.ply. Pixel (0, 0) is the center of the top left one."""
    for name in ("images", "krtd"):
        (folder / name).mkdir()
    shutil.copyfile(posed.map_folder / CLOUD, folder / "cloud.ply")
    names = []
    for frame, T in zip(posed.frames, posed.T_camera_map, strict=True):
        names.append(write_image(frame, folder / "images"))
        parts = (*_rows(posed.geometry.P_left), "", *_rows(T[:3, :3]), "", _text(T[:3, 3]), "", "0")
        (folder / "krtd" / f"{Path(names[-1]).stem}.krtd").write_text("\n".join(parts) + "\n", encoding="ascii")
    (folder / "image_list.txt").write_text("".join(f"images/{name}\n" for name in names), encoding="utf-8")


def _rows(matrix: np.ndarray) -> list[str]:
    return [_text(row) for row in matrix]


def _text(numbers: Iterable[float]) -> str:
    return " ".join(f"{number:.12g}" for number in numbers)
