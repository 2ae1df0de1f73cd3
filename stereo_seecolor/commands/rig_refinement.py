"""The refinement of a rig in a run: refined now and written to OUT, or read from an earlier run."""

from collections.abc import Sequence

from calibration import CalibrationError, StereoRig
from calibration.formats import native
from calibration.verification.matches import Matches, raw_matches
from calibration.verification.mistakes import LIMITS, likely_mistake
from stereo_seecolor.checks.rig import refine_on_dive
from stereo_seecolor.checks.sample import evenly_spaced, first_images, read_both
from stereo_seecolor.commands.rig_loading import REFINING_PAIRS
from stereo_seecolor.config import InputConfig
from stereo_seecolor.dive.run_options import RunOptions
from stereo_seecolor.errors import InputError
from stereo_seecolor.files.keys import content_key
from stereo_seecolor.inputs.pairing import Pair
from stereo_seecolor.records import FrameRow
from stereo_seecolor.run_folder.cache import KeptRefinement
from stereo_seecolor.run_folder.folder import RunFolder
from stereo_seecolor.version import __version__


def refined_for_dive(
    rig: StereoRig,
    pairs: Sequence[Pair],
    images: InputConfig,
    folder: RunFolder,
    options: RunOptions,
) -> tuple[StereoRig, str]:
    """The rig refined with pairs of a dive, or itself where that is worse; and a note.

    An earlier run's rig is used as long as the calibration and the pairs that it was refined with
    are unchanged, even if the dive has more pairs now: all frames of a folder have one rig. Raises
    OutputError, and CalibrationError for a wrong rig.
    """
    key = content_key(__version__, native.to_bytes(rig), images.model_dump())
    chosen = evenly_spaced(pairs, REFINING_PAIRS)
    earlier = KeptRefinement.load(folder.root, key)
    if earlier and (earlier_rig := earlier.stereo_rig):
        kept, known = earlier.pairs, {pair.name: pair for pair in pairs}
        if len(kept) >= len(chosen) and all(
            name in known and _hashes(known[name], folder, options) == hashes
            for name, hashes in kept.items()
        ):
            return earlier_rig, earlier.note
    used, note = _refined(rig, chosen, pairs, images, options)
    hashes_of = {pair.name: _hashes(pair, folder, options) for pair in chosen}
    KeptRefinement(native.to_content(used), hashes_of, note).save(folder.root, key)
    return used, note


def _refined(
    rig: StereoRig,
    chosen: Sequence[Pair],
    pairs: Sequence[Pair],
    images: InputConfig,
    options: RunOptions,
) -> tuple[StereoRig, str]:
    try:
        refined = refine_rig(rig, chosen, pairs, images, options)
    except CalibrationError as error:
        return rig, f"calibration: used unchanged, because it could not be refined: {error}"
    found = refined.refinement
    assert found
    if not found.movements:
        unchanged = "calibration: used unchanged, because the refined one is worse"
        return rig, f"{unchanged}: {found.summary}"
    if found.before_px > LIMITS.wrong_px:
        first = first_images(pairs, images)
        if mistake := likely_mistake(rig, first):
            raise CalibrationError(f"a wrong calibration is not refined: {mistake.line}")
    return refined, f"calibration: refined, as rig.yaml records: {found.summary}"


def refine_rig(
    rig: StereoRig,
    chosen: Sequence[Pair],
    pairs: Sequence[Pair],
    images: InputConfig,
    options: RunOptions,
) -> StereoRig:
    """The rig refined with readable pairs of a dive. Raises CalibrationError if it cannot be."""

    def matched(pair: Pair) -> tuple[Pair, Matches | None]:
        try:
            return pair, raw_matches(rig, [read_both(pair, images)])[0]
        except InputError:
            return pair, None  # the run names it

    found = []
    options.listener.begin("calibration", len(chosen))
    for pair, matches in options.compute.each(matched, chosen):
        options.listener.advance(FrameRow(pair.name))
        found += [matches] if matches else []
    return refine_on_dive(rig, found, pairs, images)


def _hashes(pair: Pair, folder: RunFolder, options: RunOptions) -> dict[str, str]:
    """SHA-256 of a pair's files, by side; empty for a pair that cannot be read."""
    sides = {"left": pair.left, "right": pair.right}
    try:
        files = folder.frames.inputs(pair.name, sides, options.verify)
    except InputError:
        return {}
    return {side: file.sha256 for side, file in files.items()}
