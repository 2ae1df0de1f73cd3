"""Images and cameras for KWIVER."""

import shutil
from pathlib import Path

from stereo_seecolor.extras.export.export_format import ExportFormat, join_numbers
from stereo_seecolor.extras.export.images_of_8_bits import write_images
from stereo_seecolor.run_folder.layout import CLOUD
from stereo_seecolor.run_folder.posed_run import PosedRun


def write_kwiver(posed: PosedRun, folder: Path) -> None:
    """Write ``images/``, ``krtd/NAME.krtd``, image_list.txt and cloud.ply for KWIVER's tools.

    A KRTD file holds K (3, 3), R (3, 3) and t (3,) of x = K (R X + t), and the distortion, with
    blank lines between them. Pixel (0, 0) is the center of the top left one.
    """
    (folder / "krtd").mkdir()
    shutil.copyfile(posed.map_folder / CLOUD, folder / "cloud.ply")
    images = write_images(posed.frames, folder)
    for image, T in zip(images, posed.T_camera_map, strict=True):
        parts = (
            *map(join_numbers, posed.geometry.P_left),
            "",
            *map(join_numbers, T[:3, :3]),
            "",
            join_numbers(T[:3, 3]),
            "",
            "0",
        )
        (folder / "krtd" / f"{image.stem}.krtd").write_text(
            "\n".join(parts) + "\n", encoding="ascii"
        )
    (folder / "image_list.txt").write_text(
        "".join(f"images/{image.name}\n" for image in images), encoding="utf-8"
    )


KWIVER = ExportFormat(
    "images, a KRTD camera for each, and the cloud", "KWIVER, TeleSculptor, VIAME", write_kwiver
)
