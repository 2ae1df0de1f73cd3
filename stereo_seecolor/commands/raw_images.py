"""The images of a finished run as the cameras gave them, rectified again."""

from calibration import Rectification
from stereo_seecolor.inputs.images import read_image
from stereo_seecolor.records import Image
from stereo_seecolor.run_folder.finished_run import FinishedRun


class RawImages:
    """The left images of a run, which must still lie where they were."""

    def __init__(self, run: FinishedRun) -> None:
        self._run, self._rectification = run, Rectification.from_rig(run.rig)

    def rectified(self, name: str) -> Image:
        """Of the frame of that name, upright. Raises InputError where it is gone."""
        raw = read_image(self._run.frame(name).left, self._run.config.input)
        return self._rectification.upright(self._rectification.apply_left(raw))
