"""The frames of two videos that are pairs: an earlier run's choice, or chosen now and kept in OUT.

To choose them, both videos are decoded completely.
"""

import json
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path

from calibration import CalibrationError, StereoRig
from calibration.formats import load_rig_of_images, native
from stereo_seecolor.config import InputConfig
from stereo_seecolor.extras.streams.videos.choice import FrameChoice
from stereo_seecolor.extras.streams.videos.video import Videos
from stereo_seecolor.files.atomic import write_atomic
from stereo_seecolor.files.keys import content_key
from stereo_seecolor.files.text_documents import load_object
from stereo_seecolor.inputs.pairing import Pairing
from stereo_seecolor.inputs.video_file import size_of_side
from stereo_seecolor.run_folder.folder import RunFolder
from stereo_seecolor.run_folder.layout import video_pairs_file
from stereo_seecolor.version import __version__


def paired_anew(left: Path, right: Path, images: InputConfig) -> Pairing:
    """The pairs of two videos, or of one that shows both sides, chosen now. Raises InputError,
    DeviceError.
    """
    videos = Videos(left, right, images.right_half_first)
    return videos.pairing(videos.choice(images))


def video_pairing(
    left: Path, right: Path, calib: str | Path, folder: RunFolder, images: InputConfig
) -> Pairing:
    """The pairs of two videos, or of one that shows both sides. Raises InputError, DeviceError,
    OutputError.
    """
    videos = Videos(left, right, images.right_half_first)
    rig: StereoRig | None = None
    with suppress(CalibrationError):  # said when the frames are opened
        rig = load_rig_of_images(calib, size_of_side(left, right))
    asked = (
        images.video_every,
        images.video_overlap,
        images.video_skip_blurred,
        images.video_offset_s,
    )
    key, file = (
        content_key(__version__, videos.key, asked, native.to_bytes(rig) if rig else b""),
        video_pairs_file(folder.root),
    )
    choice = _kept(file, key)
    if choice is None:
        choice = videos.choice(images, rig)
        write_atomic(file, json.dumps({"key": key, **asdict(choice)}).encode())
    return videos.pairing(choice)


def _kept(file: Path, key: str) -> FrameChoice | None:
    """The choice of an earlier run; None where it had other videos or settings, or there is
    none.
    """
    try:
        content = load_object(file)
        if content.pop("key") == key:
            return FrameChoice(**{name: tuple(values) for name, values in content.items()})
    except (OSError, ValueError, TypeError, KeyError, AttributeError):
        pass
    return None
