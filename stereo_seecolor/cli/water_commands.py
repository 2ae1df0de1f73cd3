"""The command water: attenuation and backscatter from places that several frames see."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from stereo_seecolor.cli.console import lines
from stereo_seecolor.cli.options import AsJson, ConfigFile, Finished, LogFile, Settings, Verbose
from stereo_seecolor.cli.report import Report

if TYPE_CHECKING:
    from stereo_seecolor.commands.water import MeasuredWater

Poses = Annotated[Path, typer.Option("--poses", metavar="FILE", help="Trajectory of the dive (TUM, KITTI, COLMAP, AUV tables).")]


def water(
    out: Finished,
    poses: Poses,
    config: ConfigFile = None,
    settings: Settings = None,
    as_json: AsJson = False,
    verbose: Verbose = False,
    log_file: LogFile = None,
) -> None:
    """Measure the water from places that several frames see; run again with --water to use it."""
    from stereo_seecolor.commands.water import measure_water
    from stereo_seecolor.config_file import load_config
    from stereo_seecolor.run_folder.finished_run import settings_file

    report = Report("water", as_json, "none", verbose, log_file)
    with report.working():
        result = measure_water(out, poses, load_config(config or settings_file(out), settings or []))
    report.end({"out": out, **vars(result)}, water_text(result))


def water_text(result: "MeasuredWater") -> str:
    """Measured attenuation, and the option that uses it."""
    errors = result.water.standard_errors["y"]
    rates = ", ".join(
        f"{name} {rate:.3f} +- {error:.3f}"
        for name, rate, error in zip(("red", "green", "blue"), result.water.y, errors, strict=True)
    )
    return lines(
        [
            f"attenuation at long range, 1/m: {rates} (nan: the sightings do not determine it)",
            f"use it with: stereo-seecolor run ... --water {result.path}",
        ]
    )
