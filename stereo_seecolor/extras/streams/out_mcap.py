"""``run --out-mcap``: a finished run as one MCAP file, with or without a map."""

from pathlib import Path

from stereo_seecolor.errors import InputError, OutputError
from stereo_seecolor.extras.streams.mcap_recording import McapRecording, is_recording
from stereo_seecolor.extras.streams.recording import recorded
from stereo_seecolor.files.atomic import atomic_path
from stereo_seecolor.run_folder.finished_run import open_run
from stereo_seecolor.run_folder.layout import MAP
from stereo_seecolor.run_folder.posed_run import open_posed_run


def check_mcap(file: Path, overwrite: bool, bag: Path | None) -> None:
    """Raise OutputError if ``file`` is there and not to be replaced: without ``overwrite``, if it
    is a part of the ``bag`` that is read, and if it is not a recording of this program.
    """
    if not (file.exists() or file.is_symlink()):
        return
    if not overwrite:
        raise OutputError(
            f"{file}: already exists: give --overwrite to replace it, or another name"
        )
    if bag and file.resolve().is_relative_to(bag.resolve()):
        raise OutputError(
            f"{file}: is an input of this run, and would be replaced: give another name; nothing "
            "was changed"
        )
    _refuse_foreign(file)


def _refuse_foreign(file: Path) -> None:
    if not is_recording(file):
        raise OutputError(
            f"{file}: is not a recording of this program, and is not replaced: give another "
            "name; nothing was changed"
        )


def write_mcap(out: Path, file: Path) -> int:
    """Record the frames of the run in ``out``, with poses for those in its map. Returns how many.

    The file appears when it is complete.

    Raises InputError if the run holds no frame or has no calibration, OutputError if the file
    cannot be written, DeviceError if a library is missing.
    """
    run = open_run(out)
    frames = [frame for frame in run.frames if "corrected" in frame.products]
    if run.geometry is None or not frames:
        raise InputError(f"{out}: holds no corrected stereo pair to record")
    placed = {}
    if (out / MAP).is_dir():
        posed = open_posed_run(out)
        placed = {frame.name: T for frame, T in zip(posed.frames, posed.T_map_camera, strict=True)}
    if file.exists():
        _refuse_foreign(file)  # it may have come while the run worked
    with atomic_path(file) as temporary, McapRecording(temporary, run.geometry) as recording:
        for number, frame in enumerate(frames):
            recording.add(recorded(frame, number, placed.get(frame.name)))
    return len(frames)
