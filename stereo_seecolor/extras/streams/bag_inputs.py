"""The stereo pairs and the calibration of a ROS bag, and the pipeline for them."""

from dataclasses import dataclass
from pathlib import Path

from calibration import CalibrationError, StereoRig
from calibration.suspicions import suspicions
from stereo_seecolor.checks.camera_response import settle_response
from stereo_seecolor.commands.rig_loading import behind_port, load_rig_for, other_size
from stereo_seecolor.commands.stereo_inputs import Opened, calibration_files, sample, settle_storage
from stereo_seecolor.config import InputConfig, RunConfig
from stereo_seecolor.extras.streams.bags.dive import BagDive, open_dive
from stereo_seecolor.pipeline import Pipeline
from stereo_seecolor.run_folder.folder import RunFolder
from stereo_seecolor.run_folder.ownership import Owner


def rig_of_bag(dive: BagDive, images: InputConfig) -> StereoRig:
    """The rig that a bag holds for its images. Raises InputError, CalibrationError."""
    rig = dive.rig()
    if other := other_size(rig, dive.pairing.pairs, images):
        sizes = ["{}x{}".format(*size) for size in (other, rig.left.image_size)]
        raise CalibrationError(
            f"{dive.bag.path}: the left images are {sizes[0]} px, but camera_info is for "
            f"{sizes[1]}: give the images that it belongs to (--topics), or a calibration for "
            "these (--calib)"
        )
    return rig


@dataclass(frozen=True, eq=False)
class BagInputs:
    """A bag and its calibration, in place of the two sides of StereoInputs.

    bag: a file, or a folder with the files of one bag. calib: as for load_rig, "" for the bag's own
    camera_info.
    topics: ``left=NAME,right=NAME``, "" to find them.
    """

    bag: Path
    calib: str | Path = ""
    topics: str = ""

    @property
    def names(self) -> dict[str, str]:
        """For run.json."""
        return {"bag": str(self.bag), "topics": self.topics, "calib": str(self.calib)}

    @property
    def paths(self) -> tuple[Path, ...]:
        """Every file and folder that is read."""
        return (self.bag, *calibration_files(self.calib))

    def owner(self, kind: str, opened: Opened | None) -> Owner:
        """The owner of an OUT of this bag: recognized by its path, or the first image's content."""
        assert opened  # by open_first
        pairs = opened.pairing.pairs
        return Owner(
            kind,
            {"bag": str(self.bag.resolve()), "topics": self.topics},
            sample(pairs[0].left),
            pairs,
        )

    def open(self, config: RunConfig) -> Opened:
        """The pairs of the bag, and the pipeline for their rig. Raises InputError,
        CalibrationError, DeviceError.
        """
        dive = open_dive(self.bag, self.topics, config.input)
        config, notes = settle_storage(config, dive.pairing.pairs)
        rig = (
            load_rig_for(self.calib, dive.pairing.pairs, config.input)
            if self.calib
            else behind_port(rig_of_bag(dive, config.input), config.input)
        )
        notes += () if self.calib else dive.static_baseline[1]
        notes += tuple(f"calibration: {suspicion}" for suspicion in suspicions(rig))
        config, response_notes = settle_response(config, dive.pairing.pairs)
        notes += response_notes
        return Opened(dive.pairing.with_notes(notes), Pipeline(rig, config))

    def open_first(self, config: RunConfig) -> Opened:
        """``open``: a bag is opened before the output folder is touched."""
        return self.open(config)

    def open_in(self, folder: RunFolder, config: RunConfig) -> Opened:
        """``open``: the output folder keeps nothing of how a bag was opened."""
        return self.open(config)
