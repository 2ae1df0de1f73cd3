"""The command line: the only place that prints, parses and exits."""

from stereo_seecolor.cli.app import main

__all__ = ["main"]
