"""Write docs/commands.md, docs/configuration.md and a table of docs/output-folder.md from the
program itself: python docs/reference.py [--check].

--check writes nothing and ends with exit code 1 where a page differs from what the program says.
"""

import re
import sys
import types
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Literal, Union, get_args, get_origin

import typer
from annotated_types import Ge, Gt, Le, Lt
from command_examples import EXAMPLES
from pydantic import BaseModel
from pydantic.fields import FieldInfo

from stereo_seecolor.cli.app import every_command, program
from stereo_seecolor.config import RunConfig
from stereo_seecolor.run_folder.replaced_results import REPLACES

HERE = Path(__file__).parent
BOUNDS = {Gt: "above", Ge: "from", Lt: "below", Le: "to"}
KINDS = {bool: "true, false", int: "integer", float: "number", str: "text", Path: "path"}

REPLACED_BEGIN, REPLACED_END = (
    "<!-- replaced: written by docs/reference.py -->",
    "<!-- end of replaced -->",
)

COMMANDS_HEAD = """# Commands

```sh
cd data_samples/reef
stereo-seecolor run --left left --right right --calib cam.yaml --out out
```

![The commands with their inputs and outputs](images/flow.svg)

The examples run in the folder of the sample dive, in this order. `stereo-seecolor COMMAND --help` prints the same
options; `stereo-seecolor --install-completion` installs Tab completion.

| for | commands |
|---|---|
"""  # noqa: E501

EXIT_CODES = """
| exit code | meaning |
|---|---|
| 0 | success |
| 1 | a known error; one line says what is wrong, where, and what to do |
| 2 | wrong usage |
| 3 | finished, with problems that the command names: failed or unpaired images, numbers that are wrong by more than their stated error, frames that are missing from the map or not connected to it, poses that do not fit |
| 130 | interrupted |
"""  # noqa: E501

COMMON_COMMANDS = 3
"""Options that this many commands share are described once."""
COMMON_HEAD = """
## Options of several commands

*Also* at the end of a command lists those of these options that it has.
"""
OPTIONS_HEAD = "| option | value | what it does |\n|---|---|---|"

CONFIGURATION_HEAD = """# Configuration

```sh
cd data_samples/reef
stereo-seecolor run --left left --right right --calib cam.yaml --out out --set color.lock=survey --set matching.max_range_m=6
```

![The stages of a run and the section of the configuration that each reads](images/flow.svg)

The defaults need no tuning. Change a setting on the command line with `--set section.key=value` (repeatable), or
several settings in a YAML file with `--config`; `--set` overrides the file:

```yaml
color:
  lock: survey
matching:
  max_range_m: 6
```

`run` writes all settings to `OUT/run.json`; `--config OUT/run.json` repeats the run. An unknown setting is
an error that suggests the most similar known one; for a setting of an earlier version it names the new one
([upgrading](upgrading.md)).

## Settings used most

| setting | when to change it |
|---|---|
| `matching.min_range_m`, `matching.max_range_m` | set the nearest and farthest range of the dive: faster, and fewer wrong matches |
| `color.lock` | `survey` for the same water parameters in all frames of a dive at one site; `frame` for unrelated frames |
| `color.unknown_pixels` | `black` or `raw` if colors must not depend on the ranges of neighbors |
| `input.timestamp_tolerance_s` | if left and right are paired by time stamps |
| `input.flat_port` | for a rig behind flat windows that was calibrated in air |
| `output.geometry` | `original` for corrected images in the pixels of the left camera as well |
| `mapping.voxel_m`, `mapping.mount` | detail of the map; pose of the camera on the vehicle |

## Color methods

`color.method` selects how the water is fitted. Each method has its own section of settings; other methods ignore it.

| `color.method` | fit | settings |
|---|---|---|
| `robust` (default) | physics with a white point, from quantiles of color over range | `color.robust` |
| `paper` | DeepSeeColor as published: [its two networks, trained by Adam](lab/theory.md#the-papers-training) | `color.paper` |

## All stages

"""  # noqa: E501


def commands_page() -> str:
    """All commands: examples, options."""
    declared = every_command()
    group = typer.main.get_command(program(declared))
    panels: dict[str, list[str]] = {}
    for name, command in declared.items():
        panels.setdefault(command.panel, []).append(name)
    commands = {name: group.commands[name] for names in panels.values() for name in names}  # type: ignore[attr-defined]
    times = Counter(
        option_row(parameter) for command in commands.values() for parameter in options_of(command)
    )
    common = [row for row, count in times.items() if count >= COMMON_COMMANDS]
    sections = (command_section(name, command, common) for name, command in commands.items())
    table = [panel_row(panel, names) for panel, names in panels.items()]
    shared = "\n".join([COMMON_HEAD, OPTIONS_HEAD, *common, ""])
    return "".join([COMMANDS_HEAD, *table, EXIT_CODES, shared, *sections])


def panel_row(panel: str, names: list[str]) -> str:
    """A row of the table of all commands."""
    links = " ".join(f"[`{name}`](#{name})" for name in names)
    return f"| {panel} | {links} |\n"


def options_of(command: Any) -> list[Any]:
    return [
        p for p in command.params if p.name not in ("help", "install_completion", "show_completion")
    ]


def command_section(name: str, command: Any, common: list[str]) -> str:
    shown = options_of(command)
    lines = ["", f"## `{name}`", "", paragraph(command.help or ""), ""]
    if name in EXAMPLES:
        lines += ["```sh", *EXAMPLES[name], "```", ""]
    own = [row for row in map(option_row, shown) if row not in common]
    also = [f"`{name_of(p)}`" for p in shown if option_row(p) in common]
    lines += [OPTIONS_HEAD, *own, ""] if own else []
    lines += [f"{'Also' if own else 'Options'}: {', '.join(also)}."] if also else []
    return "\n".join(lines).rstrip() + "\n"


def name_of(parameter: Any) -> str:
    """``--out``, or ``OUT`` for an argument."""
    if is_argument(parameter):
        return str(parameter.metavar or parameter.name.upper())
    return ", ".join(parameter.opts)


def is_argument(parameter: Any) -> bool:
    return not str(parameter.opts[0]).startswith("-")


def option_row(parameter: Any) -> str:
    annotation = parameter.type_descriptor.annotation
    value = "" if getattr(parameter, "is_flag", False) else kind(annotation)
    value = ", ".join(filter(None, (value, default_of(parameter))))
    return f"| `{name_of(parameter)}` | {value} | {cell(parameter.help or '')} |"


def default_of(parameter: Any) -> str:
    if parameter.name == "workers":
        return "default cores + 1, at most 8"
    if parameter.required:
        return "required"
    if isinstance(parameter.default, bool) or parameter.default in (None, (), ""):
        return ""
    return "" if callable(parameter.default) else f"default `{parameter.default}`"


def configuration_page() -> str:
    """All settings, a table a section."""
    return CONFIGURATION_HEAD + "\n".join(section_lines(RunConfig())) + "\n"


def section_lines(model: BaseModel, prefix: str = "") -> Iterator[str]:
    fields = {key: (getattr(model, key), field) for key, field in type(model).model_fields.items()}
    own = {key: each for key, each in fields.items() if not isinstance(each[0], BaseModel)}
    if own:
        yield from ("| setting | values | default | what it does |", "|---|---|---|---|")
        yield from (setting_row(prefix + key, *each) for key, each in own.items())
    for key in (each for each in fields if each not in own):
        value = fields[key][0]
        yield from ("", f"## `{prefix}{key}`", "", paragraph(type(value).__doc__ or ""), "")
        yield from section_lines(value, f"{prefix}{key}.")


def setting_row(key: str, default: object, field: FieldInfo) -> str:
    description = field.description or ""
    # None may be written auto
    automatic = "auto: " in description and type(None) in get_args(field.annotation)
    shown = (
        "auto"
        if automatic and default is None
        else str(default).lower()
        if isinstance(default, bool)
        else default
    )
    values = f"{'`auto`, ' if automatic else ''}{kind(field.annotation)}{bounds(field)}"
    return f"| `{key}` | {values} | {'' if shown is None else f'`{shown}`'} | {cell(description)} |"


def bounds(field: FieldInfo) -> str:
    limits = [limit for limit in field.metadata if type(limit) in BOUNDS]
    found = [
        f"{BOUNDS[type(limit)]} {getattr(limit, type(limit).__name__.lower()):g}"
        for limit in limits
    ]
    return f" {' '.join(found)}" if found else ""


def kind(annotation: Any) -> str:
    """An annotation in words: the choices of a Literal, 'number', 'path', 'number or none'."""
    origin, arguments = get_origin(annotation), get_args(annotation)
    if origin is Literal:
        return ", ".join(f"`{'none' if value is None else value}`" for value in arguments)
    if origin in (Union, types.UnionType):
        return " or ".join(kind(argument) for argument in arguments if argument is not type(None))
    if origin in (list, tuple):
        counted = [a for a in arguments if a is not Ellipsis]
        return f"{len(counted)} of {kind(counted[0])}" if len(counted) > 1 else kind(counted[0])
    if origin is not None and arguments:  # Annotated
        return kind(arguments[0])
    return KINDS.get(annotation, getattr(annotation, "__name__", str(annotation)).lower())


def cell(text: str) -> str:
    return linked(" ".join(text.split()).replace("|", "/").replace("<", "&lt;"))


def linked(text: str) -> str:
    """The text with options and file patterns as code, and pages as links."""
    text = re.sub(r"(?<![\w`-])(--[a-z][a-z-]*)", r"`\1`", text)
    text = re.sub(r"('[^']*\*[^']*')", r"`\1`", text)
    return re.sub(r"docs/([a-z-]+)\.md", r"[\1](\1.md)", text)


def paragraph(text: str) -> str:
    return linked("\n".join(line.strip() for line in text.strip().splitlines()))


def output_folder_page() -> str:
    """The page as it is, with the table of what each command may delete or replace written anew;
    commands with the same rule share a row.
    """
    head, begin, rest = (
        (HERE / "output-folder.md").read_text(encoding="utf-8").partition(REPLACED_BEGIN)
    )
    commands: dict[str, list[str]] = {}
    for command, rule in REPLACES.items():
        commands.setdefault(rule.what, []).append(f"`{command}`")
    rows = [f"| {', '.join(names)} | {what} |" for what, names in commands.items()]
    table = "\n".join(["| command | may delete or replace |", "| --- | --- |", *rows, ""])
    return f"{head}{begin}\n{table}{REPLACED_END}{rest.partition(REPLACED_END)[2]}"


def main(check: bool) -> int:
    """Write the pages, or compare them; returns the exit code."""
    stale = 0
    pages = {
        "commands.md": commands_page,
        "configuration.md": configuration_page,
        "output-folder.md": output_folder_page,
    }
    for path, text in ((HERE / name, page()) for name, page in pages.items()):
        if check and path.read_text(encoding="utf-8") != text:
            print(
                f"{path}: differs from the program; run python docs/reference.py", file=sys.stderr
            )
            stale = 1
        elif not check:
            path.write_text(text, encoding="utf-8", newline="\n")
    return stale


if __name__ == "__main__":
    sys.exit(main("--check" in sys.argv[1:]))
