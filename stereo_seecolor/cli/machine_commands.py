"""Commands about this machine and the settings of this program: doctor, config."""

from collections.abc import Sequence
from itertools import groupby
from typing import TYPE_CHECKING, Annotated, Any

from stereo_seecolor.cli import options as opt
from stereo_seecolor.cli.command import command
from stereo_seecolor.cli.errors import EXIT_DONE, EXIT_KNOWN_ERROR
from stereo_seecolor.cli.report import BareReport
from stereo_seecolor.cli.text import lines

if TYPE_CHECKING:
    from stereo_seecolor.commands.doctor import Finding
    from stereo_seecolor.config.file import Setting


Show = Annotated[bool, opt.flag("--show", "The default of this command; accepted for scripts.")]


@command("This program", "doctor")
def doctor(report: BareReport) -> None:
    """Check the installation: what is installed, what is missing, what needs it, and how to install
    it.
    """
    from stereo_seecolor.commands.doctor import doctor as examine

    found = examine()
    content = {"ready": found.ready, "findings": found.findings}
    report.end(content, doctor_text(found.findings), EXIT_DONE if found.ready else EXIT_KNOWN_ERROR)


def doctor_text(findings: "Sequence[Finding]") -> str:
    """A line for each part of the installation, and whether the program can run."""
    output = []
    for finding in findings:
        output.append(f"{_state(finding):8}  {finding.what}: {finding.detail}")
        if not finding.ok and finding.without:
            output.append(f"          without it: {finding.without}")
        if finding.fix:
            output.append(f"          fix it with: {finding.fix}")
    missing = [finding.what for finding in findings if finding.needed and not finding.ok]
    verdict = (
        f"not ready: {', '.join(missing)} must be installed first"
        if missing
        else "ready: everything that a run needs is installed"
    )
    return lines(*output, verdict)


def _state(finding: "Finding") -> str:
    """The state of a part: ok, MISSING, or optional for one that a run does not need."""
    if finding.ok:
        return "ok"
    return "MISSING" if finding.needed else "optional"


@command(
    "This program",
    "config --show --set color.lock=survey",
    "config --config OUT/run.json > settings.yaml",
)
def config(show: Show = True, *, settings: opt.Settings, report: BareReport) -> None:
    """Print the merged settings as YAML, each with its origin: the default, the file, or --set."""
    from stereo_seecolor.config.file import load_settings

    merged = load_settings(settings.config, settings.settings or [])
    report.end(
        {"settings": merged},
        lines(*_section([(setting.key.split("."), setting) for setting in merged], 0)),
    )


def _section(entries: "list[tuple[list[str], Setting]]", depth: int) -> list[str]:
    """Lines of YAML that --config can read, with each setting's origin as a comment. entries: (keys
    below this depth, setting).
    """
    output = []
    for name, group in groupby(entries, key=lambda entry: entry[0][0]):
        inside = list(group)
        if len(inside[0][0]) > 1:
            output += [
                f"{'  ' * depth}{name}:",
                *_section([(keys[1:], setting) for keys, setting in inside], depth + 1),
            ]
        else:
            setting = inside[0][1]
            output.append(f"{'  ' * depth}{name}: {_yaml(setting.value)}  # {setting.origin}")
    return output


def _yaml(value: Any) -> str:
    import yaml

    from stereo_seecolor.files.json_values import plain

    text: str = yaml.safe_dump(plain(value), default_flow_style=True, width=10**6)
    return text.removesuffix("\n").removesuffix("\n...")
