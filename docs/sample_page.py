"""Publishes the page of a run with the documentation: sphinx-build -D sample_page=OUT docs
docs/_build.
"""

import shutil
from pathlib import Path
from typing import Any

PLACE = "<!-- sample page -->"
"""Where page.md links to it."""
LINK = '<p><a href="sample/index.html">Try the page of the sample dive</a>, with its map.</p>'
SHOWN = ("index.html", "page", "corrected", "map/preview.png", "map/orthomosaic_preview.png")


def setup(app: Any) -> dict[str, bool]:
    """A Sphinx extension with one setting, sample_page: the output folder of a run."""
    app.add_config_value("sample_page", "", "html", str)
    app.connect("source-read", _link)
    app.connect("build-finished", _copy)
    return {"parallel_read_safe": True}


def _link(app: Any, name: str, source: list[str]) -> None:
    if name == "page" and app.config.sample_page:
        source[0] = source[0].replace(PLACE, LINK)


def _copy(app: Any, failed: Exception | None) -> None:
    if failed or not app.config.sample_page:
        return
    out, to = Path(app.config.sample_page), Path(app.outdir) / "sample"
    for name in SHOWN:
        if (out / name).is_dir():
            shutil.copytree(out / name, to / name, dirs_exist_ok=True)
        elif (out / name).is_file():
            (to / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(out / name, to / name)
