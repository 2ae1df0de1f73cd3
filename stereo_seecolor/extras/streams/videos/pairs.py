"""The frames of two videos that are pairs: an earlier run's choice, or chosen now and kept in OUT.

To choose them, both videos are decoded completely. Frames are read from the video when needed, and
never written to disk.
"""

import json
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path

from calibration import CalibrationError, StereoRig
from calibration.formats import load_rig_of_images, native
from stereo_seecolor.config import InputConfig
from stereo_seecolor.errors import InputError
from stereo_seecolor.extras.streams.videos.choice import FrameChoice, choose_frames
from stereo_seecolor.files.atomic import write_atomic
from stereo_seecolor.files.json_records import load_object
from stereo_seecolor.files.keys import content_key
from stereo_seecolor.inputs.halves import SIDES
from stereo_seecolor.inputs.pairing import DivePairs, Pair, Pairing
from stereo_seecolor.inputs.video_file import video_file
from stereo_seecolor.inputs.video_frames import frame_path, size_of_side
from stereo_seecolor.inputs.video_streams import recorded_at
from stereo_seecolor.records import Numbers
from stereo_seecolor.run_folder.folder import RunFolder
from stereo_seecolor.run_folder.layout import VIDEO_PAIRS, state
from stereo_seecolor.version import __version__


@dataclass(frozen=True)
class Videos:
    """The videos of a dive: one for each side, or one twice. Raises InputError, DeviceError."""

    left: Path
    right: Path
    right_half_first: bool = False

    @property
    def key(self) -> str:
        """Hash by which these videos are recognized: of their sizes and their frames' times."""
        return content_key(
            *(
                (video_file(path).index.pts.tolist(), path.stat().st_size)
                for path in (self.left, self.right)
            )
        )

    def choice(self, config: InputConfig, rig: StereoRig | None = None) -> FrameChoice:
        """The frames that make the dive: see ``choose_frames``."""
        return choose_frames(self.left, self.right, config, rig)

    def pairing(self, choice: FrameChoice) -> Pairing:
        """Pairs of the chosen frames, named by the number of the left one, with its times."""
        halves = SIDES[::-1] if self.right_half_first else SIDES
        sides = halves if self.left == self.right else ("", "")
        times_s = video_file(self.left).index.times_s + (recorded_at(self.left) or 0.0)
        pairs = [
            Pair(
                f"{left:06d}",
                frame_path(self.left, left, sides[0]),
                frame_path(self.right, right, sides[1]),
                float(times_s[left]),
            )
            for left, right in zip(choice.left, choice.right, strict=True)
        ]
        if not pairs:
            raise InputError(f"{self.left} and {self.right}: their frames form no pairs")
        files = [video_file(path) for path in dict.fromkeys((self.left, self.right))]
        notes = (note for file in files for note in file.notes)
        colors: list[Numbers] = ["colors"] if files[0].other_colors else []
        wrong = frozenset[Numbers]([*choice.wrong, *colors])
        return Pairing(DivePairs.of(pairs), (), (*choice.notes, *notes), wrong=wrong)


def pair_again(left: Path, right: Path, images: InputConfig) -> Pairing:
    """The pairs of two videos, or of one of both sides, anew. Raises InputError, DeviceError."""
    videos = Videos(left, right, images.right_half_first)
    return videos.pairing(videos.choice(images))


def video_pairing(
    left: Path, right: Path, calib: str | Path, folder: RunFolder, images: InputConfig
) -> Pairing:
    """The pairs of two videos, or of one. Raises InputError, DeviceError, OutputError."""
    videos = Videos(left, right, images.right_half_first)
    rig: StereoRig | None = None
    with suppress(CalibrationError):  # said when the frames are opened
        rig = load_rig_of_images(calib, size_of_side(left, right))
    asked = (images.video_step, images.video_skip_blurred, images.video_offset_s)
    key, file = (
        content_key(__version__, videos.key, asked, native.to_bytes(rig) if rig else b""),
        state(folder.root, VIDEO_PAIRS),
    )
    choice = _kept(file, key)
    if choice is None:
        choice = videos.choice(images, rig)
        write_atomic(file, json.dumps({"key": key, **asdict(choice)}).encode())
    pairing = videos.pairing(choice)
    if rig is None:
        return pairing
    sides = {left: rig.left, right: rig.right} if left != right else {left: rig.left}
    notes = (video_file(path).other_pixels(camera.K) for path, camera in sides.items())
    return pairing.with_notes(tuple(note for note in notes if note))


def _kept(file: Path, key: str) -> FrameChoice | None:
    """The choice of an earlier run; None where it had other videos or settings, or none."""
    try:
        content = load_object(file)
        if content.pop("key") == key:
            return FrameChoice(**{name: tuple(values) for name, values in content.items()})
    except (OSError, ValueError, TypeError, KeyError, AttributeError):
        pass
    return None
