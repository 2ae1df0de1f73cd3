"""The arguments of the benchmarks, and those that they give to a run."""

import os
from argparse import ArgumentParser, RawDescriptionHelpFormatter
from pathlib import Path


def parser_of(documentation: str | None) -> ArgumentParser:
    """A parser whose ``--help`` prints a benchmark's documentation as it is written."""
    return ArgumentParser(description=documentation, formatter_class=RawDescriptionHelpFormatter)


def words_of(documentation: str | None, names: str = "") -> list[str]:
    """The words after a benchmark's name. ``--help`` prints its documentation, and what the words
    are.
    """
    parser = parser_of(documentation)
    if names:
        parser.add_argument("words", nargs="*", metavar=names, help="see above")
    return vars(parser.parse_args()).get("words", [])


def add_data(parser: ArgumentParser, otherwise: str = ".") -> None:
    """Where the real frames are."""
    usual = Path(os.environ.get("STEREO_SEECOLOR_DATA", otherwise))
    parser.add_argument("--data", type=Path, default=usual, help="of real frames: tests/DATA.md")


def sides(dive: Path, rig: Path | None = None) -> list[str]:
    """The inputs of a run; the rig is the dive's cam.yaml unless given."""
    left, right, calibration = dive / "left", dive / "right", rig or dive / "cam.yaml"
    return ["--left", str(left), "--right", str(right), "--calib", str(calibration)]
