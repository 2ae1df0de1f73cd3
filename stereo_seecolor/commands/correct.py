"""``correct``: color alone, for images that have range maps already."""

from pathlib import Path

from stereo_seecolor.commands.dive_job import Job, claim, describe
from stereo_seecolor.commands.run import color
from stereo_seecolor.commands.stereo_inputs import sample
from stereo_seecolor.config import RunConfig
from stereo_seecolor.dive.ranged_images import RangedImages
from stereo_seecolor.dive.run_options import RunOptions
from stereo_seecolor.inputs.compression import compression_notes
from stereo_seecolor.inputs.file_form import form_notes
from stereo_seecolor.inputs.listing import folders_of
from stereo_seecolor.inputs.pairing import pair_by_stem
from stereo_seecolor.inputs.range_maps import RANGE_EXTENSIONS
from stereo_seecolor.run_folder.claim import Owner
from stereo_seecolor.run_folder.folder import RunFolder
from stereo_seecolor.run_folder.frames_table import RunSummary


def correct(
    images: Path, ranges: Path, out: Path, config: RunConfig | None = None, options: RunOptions | None = None
) -> RunSummary:
    """Correct images that have range maps (see ``read_range_map``), into ``out``.

    The images may be unrelated, so that ``color.lock: auto`` means ``frame`` here.
    Raises SeeColorError for what concerns the whole folder; a bad image is named in the summary's rows.
    """
    config, options = _unrelated(config or RunConfig()), options or RunOptions()
    pairing = pair_by_stem(images, ranges)
    pairing = pairing.with_notes((*compression_notes(pairing.pairs), *form_notes(pairing.pairs, config.color)))
    owner = Owner(
        "ranged", {"images": str(images.resolve()), "range": str(ranges.resolve())}, sample(pairing.pairs[0].left), pairing.pairs
    )
    description = describe({"images": str(images), "range": str(ranges)}, config, pairing, "corrected", options)
    job = Job(RangedImages(config), pairing, description, lambda dive, folder: color(dive, folder, pairing, options.water))
    with RunFolder(out, claim(owner, config, options, [*folders_of(images), *folders_of(ranges, RANGE_EXTENSIONS)])) as folder:
        return job.conduct(folder, options)


def _unrelated(config: RunConfig) -> RunConfig:
    """The settings with a water for each image, unless ``color.lock`` says otherwise."""
    if config.color.lock != "auto":
        return config
    return config.model_copy(update={"color": config.color.model_copy(update={"lock": "frame"})})
