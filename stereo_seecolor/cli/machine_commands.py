"""The command doctor: what this machine has and lacks."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

from stereo_seecolor.cli.console import lines
from stereo_seecolor.cli.errors import EXIT_DONE, EXIT_KNOWN_ERROR
from stereo_seecolor.cli.options import AsJson
from stereo_seecolor.cli.report import Report

if TYPE_CHECKING:
    from stereo_seecolor.commands.doctor import Finding


def doctor(as_json: AsJson = False) -> None:
    """What this machine has, what it lacks, and the command that installs it."""
    from stereo_seecolor.commands.doctor import examine

    findings = examine()
    code = EXIT_KNOWN_ERROR if any(not finding.ok and finding.needed for finding in findings) else EXIT_DONE
    Report("doctor", as_json).end({"findings": findings}, doctor_text(findings), code)


def doctor_text(findings: "Sequence[Finding]") -> str:
    """What this machine has and lacks."""
    said = []
    for finding in findings:
        said.append(f"{'ok  ' if finding.ok else 'LACK'}  {finding.what}: {finding.detail}")
        if finding.mend:
            said.append(f"      mend it with: {finding.mend}")
    return lines(said)
