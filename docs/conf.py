"""Sphinx settings; the pages of settings and commands are made from the program itself, so they cannot disagree with it."""

import subprocess
import sys
from pathlib import Path

from pydantic import BaseModel
from pydantic.fields import FieldInfo
from sphinx.application import Sphinx

from stereo_seecolor.config import RunConfig
from stereo_seecolor.version import __version__

project = "stereo-seecolor"
author = "the stereo-seecolor authors"
release = __version__
extensions = ["myst_parser"]
myst_enable_extensions = ["dollarmath", "amsmath"]
myst_heading_anchors = 3
html_theme = "furo"
html_title = f"stereo-seecolor {release}"
exclude_patterns = ["_build", "_generated"]

GENERATED = Path(__file__).parent / "_generated"
COMMANDS = (
    "inspect run correct range rectify calibrate check convert-calib water fuse view evaluate synthesize demo doctor".split()  # noqa: SIM905
)


def setup(app: Sphinx) -> None:
    app.connect("builder-inited", generate)


def generate(_: Sphinx) -> None:
    GENERATED.mkdir(exist_ok=True)
    (GENERATED / "configuration.md").write_text("\n".join(section(RunConfig())), encoding="utf-8")
    (GENERATED / "commands.md").write_text("\n".join(help_of(command) for command in COMMANDS), encoding="utf-8")


def section(model: BaseModel, prefix: str = "") -> list[str]:
    lines: list[str] = []
    for name in type(model).model_fields:
        value = getattr(model, name)
        if isinstance(value, BaseModel):
            lines += ["", f"## `{prefix}{name}`", "", type(value).__doc__ or "", ""]
            lines += ["| setting | default | values | what it does |", "|---|---|---|---|"]
            plain = [(n, f) for n, f in type(value).model_fields.items() if not isinstance(getattr(value, n), BaseModel)]
            lines += [row(f"{prefix}{name}.{n}", getattr(value, n), f) for n, f in plain]
            lines += section(value, f"{prefix}{name}.")
    return lines


def row(key: str, default: object, field: FieldInfo) -> str:
    kind = str(field.annotation).replace("typing.", "").replace("Literal", "").replace("|", "or")
    kind = kind.removeprefix("<class '").removesuffix("'>").strip("[]")
    return f"| `{key}` | `{default}` | {kind} | {(field.description or '').replace('|', '/')} |"


def help_of(command: str) -> str:
    program = Path(sys.executable).parent / "stereo-seecolor"
    environment = {"COLUMNS": "110", "TERM": "dumb", "NO_COLOR": "1", "PATH": ""}
    shown = subprocess.run([program, command, "--help"], capture_output=True, text=True, env=environment, check=True)
    return f"## {command}\n\n```text\n{shown.stdout.strip()}\n```\n"
