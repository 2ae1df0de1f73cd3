"""The refinement of a rig in a run: refined now and written to OUT, or read from an earlier run."""

from dataclasses import dataclass

from calibration import CalibrationError, StereoRig
from calibration.formats import native
from calibration.verification.mistakes import LIMITS, likely_mistake
from stereo_seecolor.checks.sample import evenly_spaced, first_images
from stereo_seecolor.commands.rig_loading import REFINING_PAIRS, refine_rig
from stereo_seecolor.config import InputConfig
from stereo_seecolor.dive.run_options import RunOptions
from stereo_seecolor.errors import InputError
from stereo_seecolor.files.keys import content_key
from stereo_seecolor.inputs.pairing import Pair, Pairing
from stereo_seecolor.run_folder.cache import KeptRefinement
from stereo_seecolor.run_folder.folder import RunFolder
from stereo_seecolor.version import __version__


@dataclass(frozen=True, eq=False)
class DiveRefinement:
    """Refines the rig of one dive into one output folder."""

    folder: RunFolder
    pairing: Pairing
    images: InputConfig
    options: RunOptions

    def of(self, rig: StereoRig) -> tuple[StereoRig, str]:
        """The refined rig, or the rig itself where refining does not make it better; and a note.

        An earlier run's rig is used as long as the calibration and the pairs that it was refined
        with are unchanged, even if the dive has more pairs now: all frames of a folder have one
        rig. Raises OutputError, and CalibrationError for a wrong rig.
        """
        key = content_key(__version__, native.to_bytes(rig), self.images.model_dump())
        earlier = KeptRefinement.load(self.folder.root, key)
        if earlier and self._holds(earlier[0]):
            return earlier[1], earlier[0].note
        used, note = self._refined(rig)
        pairs = {
            pair.name: self._hashes(pair)
            for pair in evenly_spaced(self.pairing.pairs, REFINING_PAIRS)
        }
        KeptRefinement(native.to_content(used), pairs, note).save(self.folder.root, key)
        return used, note

    def _refined(self, rig: StereoRig) -> tuple[StereoRig, str]:
        try:
            refined = refine_rig(rig, self.pairing.pairs, self.images, self.options)
        except CalibrationError as error:
            return rig, f"calibration: used unchanged, because it could not be refined: {error}"
        found = refined.refinement
        assert found
        if not found.better:
            return (
                rig,
                "calibration: used unchanged, because the refined one is not better: "
                f"{found.summary}",
            )
        if found.before_px > LIMITS.wrong_px and (
            mistake := likely_mistake(rig, first_images(self.pairing.pairs, self.images))
        ):
            raise CalibrationError(f"a wrong calibration is not refined: {mistake.line}")
        return refined, f"calibration: refined, as rig.yaml records: {found.summary}"

    def _holds(self, kept: KeptRefinement) -> bool:
        """True if the pairs it was refined with are unchanged, and are as many as a refinement now
        would use.
        """
        pairs = {pair.name: pair for pair in self.pairing.pairs}
        enough = len(kept.pairs) >= len(evenly_spaced(self.pairing.pairs, REFINING_PAIRS))
        return enough and all(
            name in pairs and self._hashes(pairs[name]) == hashes
            for name, hashes in kept.pairs.items()
        )

    def _hashes(self, pair: Pair) -> dict[str, str]:
        """SHA-256 of a pair's files, by side; empty for a pair that cannot be read, which the run
        names.
        """
        try:
            files = self.folder.frames.inputs(
                pair.name, {"left": pair.left, "right": pair.right}, self.options.verify
            )
        except InputError:
            return {}
        return {side: file.sha256 for side, file in files.items()}
