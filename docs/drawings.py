"""The drawings of the documentation as SVG: the flow of a run, the axes, and the packages of the
code with their real imports.

python docs/drawings.py writes docs/images/{flow,axes,packages}.svg and the table of
docs/lab/architecture.md.
"""

import ast
import re
import tomllib
from html import escape
from pathlib import Path

import grimp

HERE = Path(__file__).parent
ROOT = HERE.parent
GROUND = tuple(f"stereo_seecolor.{name}" for name in ("errors", "version", "records", "config"))
"""Rooms that nearly all others import: their arrows are left out of the drawing."""

INK, SOFT, FILL, MARK = "#1f2d3d", "#7b8794", "#e8f1f5", "#0b7285"
TIP = (
    '<marker id="tip" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="7" markerHeight="7" '
    'orient="auto">'
    '<path d="M0 0L8 4L0 8z"/></marker>'
)
FLOW_NOTE = (
    "Each stage works on one pair; pairs run in parallel. Counts of all pairs are added: "
    "a survey can share one water."
)
OTHER_COMMANDS = (
    "calibrate, check, convert-calib: the calibration.  evaluate: a run against "
    "known truth.  view: the map."
)


class Drawing:
    """An SVG picture that is put together from boxes, lines and texts; units are pixels."""

    def __init__(self, width: int, height: int, title: str) -> None:
        self.size, self.title, self.parts = (width, height), title, list[str]()

    def text(
        self,
        at: tuple[float, float],
        words: str,
        color: str = INK,
        anchor: str = "middle",
        size: int = 12,
        bold: bool = False,
    ) -> None:
        style = (
            f'font-size="{size}" fill="{color}" text-anchor="{anchor}" '
            f'font-weight="{600 if bold else 400}"'
        )
        self.parts.append(f'<text x="{at[0]:g}" y="{at[1]:g}" {style}>{escape(words)}</text>')

    def box(self, x: float, y: float, width: float, height: float, lines: list[str]) -> None:
        self.parts.append(
            f'<rect x="{x:g}" y="{y:g}" width="{width:g}" height="{height:g}" rx="6" '
            f'fill="{FILL}" stroke="{SOFT}"/>'
        )
        top = y + height / 2 - 8 * (len(lines) - 1) + 4
        self.text((x + width / 2, top), lines[0], size=13, bold=True)
        for i, line in enumerate(lines[1:], 1):
            self.text((x + width / 2, top + 16 * i), line, SOFT, size=11)

    def line(
        self,
        start: tuple[float, float],
        end: tuple[float, float],
        color: str = INK,
        arrow: bool = True,
        width: float = 1.3,
    ) -> None:
        tip = ' marker-end="url(#tip)"' if arrow else ""
        place = f'x1="{start[0]:g}" y1="{start[1]:g}" x2="{end[0]:g}" y2="{end[1]:g}"'
        self.parts.append(f'<line {place} stroke="{color}" stroke-width="{width}"{tip}/>')

    def curve(self, start: tuple[float, float], end: tuple[float, float]) -> None:
        (x1, y1), (x2, y2) = start, end
        path = (
            f"M{x1:.0f} {y1:.0f} C{x1:.0f} {(y1 + y2) / 2:.0f} {x2:.0f} {(y1 + y2) / 2:.0f} "
            f"{x2:.0f} {y2:.0f}"
        )
        self.parts.append(f'<path d="{path}" fill="none" stroke="{MARK}" stroke-opacity="0.35"/>')

    def write(self, path: Path) -> None:
        width, height = self.size
        head = (
            f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" '
            f'width="{width}" height="{height}" '
            'font-family="system-ui, sans-serif" '
            f'role="img"><title>{escape(self.title)}</title><defs>{TIP}</defs>'
            f'<rect width="{width}" height="{height}" fill="#ffffff"/>'
        )
        path.write_text(
            "\n".join([head, *self.parts, "</svg>", ""]), encoding="utf-8", newline="\n"
        )


def draw_flow() -> None:
    """What a run does with a pair, the command that begins there, and the section of the
    configuration that each stage reads.
    """
    drawing = Drawing(1000, 300, "The flow of a run")
    stages = [
        ("left, right", ["images or videos"], "--left --right", "input"),
        ("rectify", ["rectified pair"], "rectify", ""),
        ("match", ["range, its error,", "confidence"], "range", "matching"),
        ("count", ["range-value", "histogram"], "", "color"),
        ("fit water", ["water.json"], "water", "color"),
        ("correct", ["true-color", "image, cloud"], "correct", "color, output"),
        ("fuse", ["map of the dive"], "fuse", "mapping"),
    ]
    step, width = 140, 118
    for i, (name, product, command, section) in enumerate(stages):
        x = 16 + i * step
        drawing.box(x, 120, width, 62, [name, *product])
        drawing.text((x + width / 2, 92), command, MARK, size=13, bold=True)
        drawing.text((x + width / 2, 214), section, SOFT)
        if i:
            drawing.line((x - step + width, 151), (x, 151))
    drawing.text((16, 40), "Command that begins here", MARK, "start", bold=True)
    drawing.text((16, 60), "Stage, and what it makes", INK, "start", bold=True)
    drawing.text((230, 40), "Section of the configuration that it reads", SOFT, "start", bold=True)
    for y, words in ((262, FLOW_NOTE), (284, OTHER_COMMANDS)):
        drawing.text((16, y), words, INK, "start")
    drawing.write(HERE / "images" / "flow.svg")


def draw_axes() -> None:
    """The cameras' axes, the baseline, and the difference between depth and range."""
    drawing = Drawing(760, 330, "Axes of the cameras, depth and range")
    left, right, point = (180, 70), (330, 70), (470, 270)
    for (x, y), name in ((left, "left"), (right, "right")):
        drawing.box(x - 55, y - 36, 110, 36, [f"{name} camera"])
        drawing.line((x, y), (x + 60, y), MARK)
        drawing.line((x, y), (x, y + 60), MARK)
        drawing.text((x + 66, y + 4), "x", MARK, "start", 13, bold=True)
        drawing.text((x - 12, y + 64), "z", MARK, size=13, bold=True)
    drawing.text(
        (right[0] + 130, right[1] + 4),
        "y: toward you, out of the page (down in the image)",
        SOFT,
        "start",
        11,
    )
    drawing.line((left[0], 22), (right[0], 22), SOFT, arrow=False)
    drawing.text(((left[0] + right[0]) / 2, 16), "baseline_m", SOFT)
    drawing.line(left, point)
    drawing.text((360, 180), "range_m (along the ray)", INK, "start", 13, bold=True)
    drawing.line(left, (left[0], point[1]), SOFT)
    drawing.text((left[0] - 8, 200), "depth_m (along z)", SOFT, "end", 13, bold=True)
    drawing.line((40, point[1]), (640, point[1]), "#b08d57", arrow=False, width=3)
    drawing.text((600, 292), "reef", "#8a6a3b", size=13)
    drawing.text(
        (16, 318),
        "World: east, north, up when georeferenced. T_world_camera: from the camera to the world.",
        SOFT,
        "start",
    )
    drawing.write(HERE / "images" / "axes.svg")


def draw_packages() -> list[str]:
    """The packages in their layers with the imports between them; returns the packages."""
    layers = layers_of_packages()
    packages = [package for layer in layers for package in layer]
    imports = package_imports(packages)
    drawing = Drawing(1000, 40 + 84 * len(layers), "The packages of the code and their imports")
    at: dict[str, tuple[float, float]] = {}
    for row, layer in enumerate(layers):
        width = min(150, 960 / len(layer) - 10)
        start = 500 - (width + 10) * len(layer) / 2
        for i, package in enumerate(layer):
            at[package] = (start + i * (width + 10) + width / 2, 20 + row * 84)
    for package in packages:
        for other in direct_imports(package, imports):
            drawing.curve((at[package][0], at[package][1] + 40), at[other])
    for layer in layers:
        width = min(150, 960 / len(layer) - 10)
        for package in layer:
            drawing.box(
                at[package][0] - width / 2,
                at[package][1],
                width,
                40,
                [package.removeprefix("stereo_seecolor.")],
            )
    drawing.write(HERE / "images" / "packages.svg")
    return packages


def direct_imports(package: str, imports: dict[str, list[str]]) -> list[str]:
    """The packages that a package imports and that no other of them imports too, directly or by
    others.
    """
    chosen = [other for other in imports[package] if other not in GROUND]
    return [
        other for other in chosen if not any(other in reached(third, imports) for third in chosen)
    ]


def reached(package: str, imports: dict[str, list[str]]) -> set[str]:
    """All that a package imports, directly or by others."""
    return set(imports[package]).union(*(reached(other, imports) for other in imports[package]))


def layers_of_packages() -> list[list[str]]:
    """The layers of import-linter's contract, from the top down."""
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    contract = next(
        c for c in settings["tool"]["importlinter"]["contracts"] if c["type"] == "layers"
    )
    return [
        [package.strip(" ()") for package in re.split(r"[|:]", layer)]
        for layer in contract["layers"]
    ]


def package_imports(packages: list[str]) -> dict[str, list[str]]:
    graph = grimp.build_graph("stereo_seecolor", "calibration", cache_dir=None)
    found: dict[str, set[str]] = {package: set() for package in packages}
    for module in graph.modules:
        for other in graph.find_modules_directly_imported_by(module):
            source, target = package_of(module, packages), package_of(other, packages)
            if source and target and source != target:
                found[source].add(target)
    below = {
        package: number for number, layer in enumerate(layers_of_packages()) for package in layer
    }
    return {
        package: sorted(other for other in found[package] if below[package] < below[other])
        for package in packages
    }


def package_of(module: str, packages: list[str]) -> str:
    return max(
        (package for package in packages if module == package or module.startswith(f"{package}.")),
        key=len,
        default="",
    )


def table_of_packages(packages: list[str]) -> str:
    """Packages and their content."""
    lines = ["| package | content |", "| --- | --- |"]
    for package in packages:
        place = ROOT / package.replace(".", "/")
        if not place.is_dir():
            continue
        lines.append(f"| `{package.removeprefix('stereo_seecolor.')}` | {first_line(place)} |")
    return "\n".join(lines)


def first_line(place: Path) -> str:
    """The first sentence of the docstring of a package."""
    text = (place / "__init__.py").read_text(encoding="utf-8")
    words = (ast.get_docstring(ast.parse(text)) or "").split("\n\n")[0]
    return " ".join(words.split()).replace("|", "/")


def write_table(name: str, table: str) -> None:
    page = HERE / "lab" / "architecture.md"
    text = page.read_text(encoding="utf-8")
    begin, end = f"<!-- {name}: written by docs/drawings.py -->\n", f"\n<!-- end of {name} -->"
    head, rest = text.split(begin)
    page.write_text(head + begin + table + end + rest.split(end)[1], encoding="utf-8", newline="\n")


if __name__ == "__main__":
    draw_flow()
    draw_axes()
    write_table("packages", table_of_packages(draw_packages()))
