"""Tables and records of OUT that were cut, edited or damaged: every command that reads them ends
well, or in one line.
"""

import json
import os
import shutil
from collections.abc import Callable, Collection
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from calibration import CalibrationError
from stereo_seecolor.commands.fuse import fuse
from stereo_seecolor.commands.report import report
from stereo_seecolor.dive.run_options import RunOptions
from stereo_seecolor.errors import InputError, SeeColorError
from stereo_seecolor.extras.evaluation.evaluate_run import evaluate_spread
from stereo_seecolor.extras.evaluation.water import measure_water
from stereo_seecolor.extras.export.command import export
from stereo_seecolor.extras.fleet.merge import merge
from stereo_seecolor.extras.fleet.status import status
from stereo_seecolor.extras.reef.compare import compare
from stereo_seecolor.extras.reef.markers import Known, markers
from stereo_seecolor.extras.reef.measure import measure
from stereo_seecolor.extras.reef.metrics import metrics
from stereo_seecolor.files import csv_tables
from stereo_seecolor.files.decode import read_array
from stereo_seecolor.files.encode import encode_map
from stereo_seecolor.files.json_records import load_object
from stereo_seecolor.files.ply import read_triangles, read_vertices
from stereo_seecolor.files.png import encode_png
from stereo_seecolor.inputs.exposure_table import ExposureTable
from stereo_seecolor.mapping.marker_tables import read_bars
from stereo_seecolor.run_folder.cache import kept
from stereo_seecolor.run_folder.finished_run import FinishedFrame
from stereo_seecolor.run_folder.frames_csv import read_rows


def _cells(change: Callable[[str], str]) -> Callable[[bytes], bytes]:
    """Change every cell below the header."""

    def changed(content: bytes) -> bytes:
        head, *rows = content.decode().splitlines()
        return "\n".join(
            [head, *(",".join(change(cell) for cell in row.split(",")) for row in rows)]
        ).encode()

    return changed


def _values(change: Callable[[Any], Any]) -> Callable[[bytes], bytes]:
    """Change every value of a JSON file and of the objects directly in it, but for what says which
    kind of file it is.
    """

    def member(key: str, value: Any) -> Any:
        if key.startswith("format"):
            return value
        return (
            {inner: change(v) for inner, v in value.items()}
            if isinstance(value, dict)
            else change(value)
        )

    return lambda content: json.dumps(
        {key: member(key, value) for key, value in json.loads(content).items()}
    ).encode()


Damage = Callable[[bytes], bytes]
ANY: dict[str, Damage] = {
    "empty": lambda content: b"",
    "cut in the middle": lambda content: content[: len(content) // 2],
    "cut at its end": lambda content: content[:-3],
    "no text": lambda content: b"\xff\xfe\x00" + content,
    "zeros at its end": lambda content: content[: len(content) // 2] + bytes(len(content) // 2),
    "a long line": lambda content: content + b"9" * 200_000,
}
IN_TABLES: dict[str, Damage] = {
    "the header alone": lambda content: content.splitlines(keepends=True)[0],
    "no header": lambda content: b"\n".join(content.splitlines()[1:]),
    "rows that are short": lambda content: b"\n".join(
        [content.splitlines()[0], *(row[:9] for row in content.splitlines()[1:])]
    ),
    "rows that are long": lambda content: b"\n".join(
        row + b",1,2,3" for row in content.splitlines()
    ),
    "words for numbers": _cells(lambda cell: f"{cell}x"),
    "nothing known": _cells(lambda cell: ""),
    "NaN": _cells(lambda cell: "nan"),
    "huge numbers": _cells(lambda cell: "1e999"),
    "an open quote": lambda content: content.replace(b",", b',"', 3),
    "a long cell": _cells(lambda cell: cell + "9" * 150_000),
}
IN_RECORDS: dict[str, Damage] = {
    "another kind": lambda content: b"[1, 2]",
    "no keys": lambda content: b"{}",
    "null": _values(lambda value: None),
    "words": _values(lambda value: "word"),
    "lists": _values(lambda value: [value]),
    "objects": _values(lambda value: {"a": value}),
    "NaN": _values(lambda value: float("nan")),
    "huge numbers": _values(lambda value: 1e308),
    "deep": lambda content: b'{"a":' * 3000 + b"1" + b"}" * 3000,
}


def damages(file: str) -> dict[str, Damage]:
    """What is done to a file."""
    of_kind = {".csv": IN_TABLES, ".json": IN_RECORDS}
    return ANY | of_kind.get(Path(file).suffix, {})


def commands(fused: Path, folder: Path) -> dict[str, Callable[[], object]]:
    out, poses, points = folder / "out", fused / "poses.tum", folder / "points.csv"
    points.write_text(
        "measure,frame,kind,label,x_px,y_px,x_m,y_m\n1,0000,point,a,40,30,,\n2,,point,b,,,0.1,0.1\n"
    )
    return {
        "status": lambda: status(out),
        "measure": lambda: measure(out, points),
        "export": lambda: export(out, "kwiver", folder / "kwiver"),
        "report": lambda: report(out),
        "metrics": lambda: metrics(out),
        "compare": lambda: compare(fused / "out", out),
        "markers": lambda: markers(out, Known(0.2)),
        "water": lambda: measure_water(out, poses),
        "evaluate": lambda: evaluate_spread(out),
        "fuse": lambda: fuse(out, poses),
        "merge": lambda: merge([out], folder / "merged", RunOptions(workers=1)),
        "colmap": lambda: export(out, "colmap", folder / "colmap"),
    }


def named_in_one_line(
    fused: Path, file: str, damaged: bytes, names: Collection[str], folder: Path
) -> int:
    """Run these commands on an OUT with a damaged file, each on a copy of its own; gives how many
    refused it.
    """
    folder.mkdir()
    out, refused = folder / "out", 0
    for name, command in commands(fused, folder).items():
        if name in names:
            shutil.rmtree(out, ignore_errors=True)
            # links, which the program replaces and never writes into
            shutil.copytree(fused / "out", out, copy_function=os.link)
            (out / file).unlink()
            (out / file).write_bytes(damaged)
            try:
                command()
            except (SeeColorError, CalibrationError) as error:
                refused += 1
                assert "\n" not in str(error), name
    return refused


READ = {
    "frames.csv": ("report", "status"),
    "map/poses.csv": ("report", "export", "metrics", "markers"),
    "map/reef_metrics.csv": ("report", "export"),
    "map/map.json": ("report", "export", "metrics", "markers", "water", "colmap"),
    "run.json": (
        *("report", "status", "measure", "export"),
        *("metrics", "markers", "water", "merge", "fuse"),
    ),
    "map/mesh.ply": ("metrics", "compare"),
    "map/cloud.ply": ("colmap",),
    "map/trajectory.tum": ("metrics", "markers", "colmap"),
    "rig.yaml": ("metrics", "water", "merge", "evaluate"),
    "water.json": ("merge", "water"),
    "range/0001.tiff": ("metrics", "water", "fuse"),
    "confidence/0001.png": ("metrics", "water", "fuse"),
    "corrected/0001.png": ("evaluate", "compare", "fuse"),
    "range_std/0001.tiff": ("metrics", "fuse", "evaluate"),
    ".state/frames/0001.json": ("metrics", "merge", "water"),
    ".state/manifest.json": ("metrics", "merge", "water"),
    ".state/tables/0001.kept": ("merge",),
}
"""File of OUT -> commands that read it."""


GRAVE = ("cut in the middle", "zeros at its end")


@pytest.mark.slow
@pytest.mark.parametrize("file", READ)
def test_damage_of_a_file_that_a_command_reads_is_one_line(
    file: str, fused_dive: Path, tmp_path: Path
) -> None:
    """All kinds of damage for the first command of the list; for the others, which read it by the
    same function, the gravest.
    """
    content = (fused_dive / "out" / file).read_bytes()
    refused = [
        named_in_one_line(fused_dive, file, damaged(content), tried(file, kind), tmp_path / kind)
        for kind, damaged in damages(file).items()
    ]
    assert any(refused) or file.endswith(".kept"), "no command reads this file"


def tried(file: str, damage: str) -> tuple[str, ...]:
    return READ[file] if damage in GRAVE else READ[file][:1]


def test_the_table_of_attacks_counts_these_cases() -> None:
    table = (Path(__file__).parent / "README.md").read_text()
    cases = sum(len(tried(file, damage)) for file in READ for damage in damages(file))
    (row,) = [row for row in table.splitlines() if f"`{Path(__file__).name}`" in row]
    assert int(row.split("|")[2]) == cases


@pytest.mark.parametrize("product", ["range", "range_std", "confidence", "mask", "corrected"])
def test_an_image_of_another_kind_in_the_place_of_a_product_is_named(
    tmp_path: Path, product: str
) -> None:
    others = {
        "color": np.zeros((6, 8, 3), np.uint8),
        "gray": np.zeros((6, 8), np.uint8),
        "range": np.ones((6, 8), np.float32),
    }
    fitting = {"range": ("range",), "range_std": ("range",), "corrected": tuple(others)}
    for kind, pixels in others.items():
        path = tmp_path / ("a.tiff" if kind == "range" else "a.png")
        path.write_bytes(encode_map(pixels, False) if kind == "range" else encode_png(pixels))
        frame = FinishedFrame("a", None, path, "", {product: path, "confidence": path})
        if kind in fitting.get(product, ("gray",)):
            assert frame.read(product).shape == pixels.shape
        else:
            with pytest.raises(InputError, match="another kind of image"):
                frame.read(product)


@pytest.mark.parametrize("form", ["png", "tiff", "deflated.tiff"])
def test_a_damaged_image_of_the_program_is_not_decoded(tmp_path: Path, form: str) -> None:
    """By OpenCV and by the program's own decoder; a byte that changed in pixels without a checksum
    cannot be seen.
    """
    values = np.random.default_rng(0).uniform(1, 2, (48, 64)).astype(np.float32)
    content = (
        bytes(encode_png((100 * values).astype(np.uint8)))
        if form == "png"
        else encode_map(values, form.startswith("deflated"))
    )
    path = tmp_path / f"0000.{form.rpartition('.')[2]}"
    path.write_bytes(content)
    assert read_array(path).shape == values.shape
    middle = len(content) // 2
    changed = content[:middle] + bytes([content[middle] ^ 0x55]) + content[middle + 1 :]
    for damaged in (b"", content[:middle], content[:-20], *([] if form == "tiff" else [changed])):
        path.write_bytes(damaged)
        with pytest.raises(InputError, match="damaged"):
            read_array(path)


@pytest.mark.parametrize("form", ["png", "tiff", "jpg"])
def test_an_image_of_another_size_is_refused_by_its_header(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, form: str
) -> None:
    """A small file of a stranger's may hold gigabytes of pixels."""
    pixels = np.zeros((6, 8), np.float32 if form == "tiff" else np.uint8)
    path = tmp_path / f"a.{form}"
    if form == "tiff":
        path.write_bytes(encode_map(pixels, False))
    else:
        cv2.imwrite(str(path), pixels)
    product = "range" if form == "tiff" else "corrected"
    fitting = FinishedFrame("a", None, path, "", {product: path}, size=(8, 6))
    assert fitting.size is not None and read_array(path, fitting.size).shape == (6, 8)

    def decoded(*_: object) -> None:
        raise AssertionError("a pixel was decoded")

    monkeypatch.setattr("stereo_seecolor.files.decode.quickly_decoded", decoded)
    monkeypatch.setattr("cv2.imdecode", decoded)
    with pytest.raises(InputError, match="damaged"):
        replace(fitting, size=(6, 8)).read(product)
    monkeypatch.setattr("stereo_seecolor.files.image_headers.MAX_PIXELS", 47)
    with pytest.raises(InputError, match="damaged"):
        replace(fitting, size=None).read(product)


@pytest.mark.timeout(30)
def test_a_named_pipe_in_the_place_of_a_file_of_out_is_not_waited_for(tmp_path: Path) -> None:
    """An OUT from a share may hold one; opening it waits for another program to write."""
    path = tmp_path / "file"
    os.mkfifo(path)
    for read in (read_array, load_object, read_rows, read_vertices, read_triangles):
        with pytest.raises((InputError, OSError)):
            read(path)
    assert kept(path, "key") is None


def test_a_cell_of_any_length_is_one_line(tmp_path: Path) -> None:
    path = tmp_path / "table.csv"
    path.write_text("name,exposure_s\na," + "9" * 200_000 + "\n")

    def read_rows(path: Path) -> None:
        list(csv_tables.rows(path, ("name",)))

    for read in (ExposureTable.read, read_bars, read_rows):
        with pytest.raises(InputError):
            read(path)
