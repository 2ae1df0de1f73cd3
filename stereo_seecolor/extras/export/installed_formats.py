"""The export formats of all installed packages, by name."""

from stereo_seecolor.extras.export.export_format import ExportFormat
from stereo_seecolor.plugins import added, load


def export_formats() -> dict[str, ExportFormat]:
    """What each format writes, and the function that writes it. Raises PluginError for a package
    that cannot be loaded.
    """
    return {name: load("exports", name, ExportFormat) for name in added("exports")}
