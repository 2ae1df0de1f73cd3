"""One water for the dives of a site, fitted to the color counts of all their frames."""

import logging
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from calibration import CalibrationError
from stereo_seecolor.color.corrector import Corrector
from stereo_seecolor.color.sharing.survey import Fitter
from stereo_seecolor.commands.run_session import stereo_run
from stereo_seecolor.commands.stereo_inputs import StereoInputs
from stereo_seecolor.config import RunConfig
from stereo_seecolor.dive.passes import count_frames, measure_ranges
from stereo_seecolor.dive.run_options import RunOptions
from stereo_seecolor.errors import SeeColorError
from stereo_seecolor.extras.fleet.campaign_files import write_own
from stereo_seecolor.run_folder.water_file import waters_content

log = logging.getLogger(__name__)


@dataclass(frozen=True, eq=False)
class SiteDive:
    """A dive of a site. out: its output folder, which gets ranges and moment tables. water: the
    file for its water.
    """

    inputs: StereoInputs
    out: Path
    config: RunConfig
    water: Path


def fit_site(dives: Sequence[SiteDive], options: RunOptions) -> bool:
    """Measure all pairs of all dives, fit one water to them, and write it for each dive, scaled to
    each frame's exposure.

    The fit uses the color settings of the first dive that can be measured, with its response. A
    dive that cannot be measured is named in the log and left out.
    Returns True if it was stopped. Raises ColorError where no frame of the site has a known range,
    OutputError.
    """
    fitter: Fitter | None = None
    names: dict[Path, list[str]] = {}
    for dive in dives:
        try:
            with stereo_run(
                dive.inputs, dive.out, dive.config, options, "range", ("ranges", "waters")
            ) as run:
                measure_ranges(run)
                color = run.frames.source.corrector.config.model_copy(update={"lock": "survey"})
                fitter = fitter or Corrector(color).survey_fitter()
                for name, table in count_frames(run, None):
                    fitter.add(_key(dive.water, name), table)
        except (SeeColorError, CalibrationError) as error:
            log.warning("%s: takes no part in its site's water: %s", dive.out.name, error)
            continue
        if run.summary.stopped:
            return True
        names[dive.water] = [row.name for row in run.summary.rows if row.status != "unpaired"]
    if fitter and names:
        _write(fitter, names)
    return False


def _write(fitter: Fitter, names: dict[Path, list[str]]) -> None:
    """Write each dive's file. A failed frame gets another's water, for when it is repaired."""
    waters = fitter.waters()
    usual = next(iter(waters.values()))
    for file, frames in names.items():
        write_own(
            file.parent.parent,
            file,
            waters_content({name: waters.get(_key(file, name), usual) for name in frames}),
        )


def _key(file: Path, name: str) -> str:
    """A frame's name in the fit: dives may have frames of the same name."""
    return f"{file.stem}/{name}"
