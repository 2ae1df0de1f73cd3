"""Videos as input: which of their frames are pairs. Frames are read from the video when needed, and
never written to disk.
"""

from dataclasses import dataclass
from pathlib import Path

from calibration import StereoRig
from stereo_seecolor.config import InputConfig
from stereo_seecolor.errors import InputError
from stereo_seecolor.extras.streams.videos.choice import FrameChoice, choose_frames
from stereo_seecolor.files.keys import content_key
from stereo_seecolor.inputs.dive_pairs import SIDES
from stereo_seecolor.inputs.pairing import DivePairs, Pair, Pairing
from stereo_seecolor.inputs.video_file import frame_path, recorded_at, video_file


@dataclass(frozen=True)
class Videos:
    """The videos of a dive: one for each side, or twice the same one that shows both. Raises
    InputError, DeviceError.
    """

    left: Path
    right: Path
    right_half_first: bool = False

    @property
    def key(self) -> str:
        """Hash by which these videos are known again: of their sizes, and the times of their
        frames.
        """
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
        """Make pairs of the chosen frames, named after the number of the left one. Times are those
        of the left video.
        """
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
            raise InputError(f"{self.left} and {self.right}: no frames of them are pairs")
        notes = (
            note
            for path in dict.fromkeys((self.left, self.right))
            for note in video_file(path).notes
        )
        return Pairing(DivePairs.of(pairs), (), (*choice.notes, *notes))
