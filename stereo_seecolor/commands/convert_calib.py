"""Convert a calibration into another format."""

from dataclasses import dataclass, replace
from pathlib import Path

from calibration.errors import CalibrationError
from calibration.formats import WritableFormat, load_rig, parse_size, paths_of, write_rig
from calibration.resizing import resized_rig
from calibration.suspicions import suspicions
from stereo_seecolor.files.free_places import refuse_existing
from stereo_seecolor.run_folder.own_paths import refuse_own_place

ENDINGS: dict[WritableFormat, tuple[str, ...]] = {
    "native": (".yaml", ".yml"),
    "kalibr": (".yaml", ".yml"),
    "matlab": (".mat",),
    "viame": (".json",),
}
"""Of the formats with one notation. An ending of no other tool is left to the user."""
FOREIGN_ENDINGS = {".yaml", ".yml", ".mat", ".json", ".xml", ".npz"}


@dataclass(frozen=True)
class ConvertedCalibration:
    """A calibration that was written. baseline_m: of the rig; it shows a wrong unit. notes: a line
    on each guess. readings: in how many ways the source can be read.
    """

    source: str
    out: str
    format: WritableFormat
    baseline_m: float
    notes: tuple[str, ...] = ()
    readings: int = 1


def convert_calib(
    source: str,
    out: str | Path,
    to: WritableFormat = "native",
    size: str | None = None,
    resize: str | None = None,
) -> ConvertedCalibration:
    """Read ``source`` in any known format and write it as ``to``; rays of pixels stay the same.

    size: WIDTHxHEIGHT, for a source that does not state it. resize: WIDTHxHEIGHT of images that
    were binned or resized since.
    out: new. Raises CalibrationError, OutputError.
    """
    _refuse_ending(Path(out), to)
    refuse_own_place(*paths_of(out, to))
    refuse_existing(*paths_of(out, to))
    rig = load_rig(source, parse_size(size) if size else None)
    if size and rig.left.image_size != parse_size(size):
        width, height = rig.left.image_size
        raise CalibrationError(
            f"{source}: states images of {width}x{height} px, not {size}: leave --size out, or "
            "give --resize if the images were resized since"
        )
    if resize:
        rig = resized_rig(rig, parse_size(resize))
    write_rig(rig, out, to)
    notes, ways = list(suspicions(replace(rig, alternatives=()))), 1 + len(rig.alternatives)
    if ways > 1:
        notes.append(
            f"{rig.reading}: used, but the file can be read in {ways} ways: "
            "images of the dive decide, by 'stereo-seecolor check --left ... --right ... --calib "
            f"{source} --refine refined.yaml'; then convert refined.yaml"
        )
    return ConvertedCalibration(source, str(out), to, rig.baseline_m, tuple(notes), ways)


def _refuse_ending(out: Path, to: WritableFormat) -> None:
    """Raise CalibrationError for a name that other tools would take for another notation."""
    own, ending = ENDINGS.get(to, ()), out.suffix.lower()
    if own and ending in FOREIGN_ENDINGS.difference(own):
        raise CalibrationError(
            f"{out}: a file of the {to} format ends in {own[0]}: name it so, or choose another "
            "format with --to"
        )
