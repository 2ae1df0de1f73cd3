"""The uncorrected left images of a finished run."""

from calibration import Rectification
from stereo_seecolor.color.response.response import Response
from stereo_seecolor.inputs.images import read_image
from stereo_seecolor.records import Image
from stereo_seecolor.run_folder.finished_run import FinishedRun


class RawImages:
    """Reads the left images of a run from where the run read them."""

    def __init__(self, run: FinishedRun) -> None:
        self._run, self._rectification = run, Rectification.from_rig(run.rig)

    def rectified(self, name: str) -> Image:
        """The rectified left image of a frame, upright, as sRGB values without a pedestal. Raises
        InputError where its file is missing.
        """
        raw = read_image(self._run.frame(name).left, self._run.config.input)
        response = Response.of(self._run.config.color).of_frame(raw)
        return response.standard(self._rectification.upright(self._rectification.apply_left(raw)))
