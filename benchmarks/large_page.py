"""How a browser shows a map of many frames.

    python benchmarks/large_page.py OUT FOLDER --frames 2400 [--written 3]

OUT is a run with a map and its page, of which the pieces are repeated side by side: what is
measured is the page's own program with as many pieces, of the same sizes and in the same tree, as a
map of that many frames has. Coarser pieces above the repeated ones have the triangles and the
images of OUT's coarsest one, stretched. The files of the repeated ones are written only for so many
copies around the middle (--written), where the view goes. FOLDER is new, for the page.

Prints, of Chromium without a graphics card in a window of 1280x800: seconds to the first picture
and until all is loaded, memory of the page's script and of the processes that draw it, and
processor time of a picture of a moving view; of the whole map, near, and after flights over it.
"""

import json
import math
import os
import re
import shutil
import time
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlsplit

import cv2
import numpy as np
from arguments import parser_of
from playwright.sync_api import Page, sync_playwright

from stereo_seecolor.report.frame_blocks import blocks_of
from stereo_seecolor.report.templates import ESCAPE, MOVED, script

SOFTWARE = ("--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")
KIND = re.compile("--type=([a-z-]+)")
"""Of a process of Chromium."""
LIGHT = 110
"""Of 255: the stage behind the reef is darker."""
FLIGHTS = 12
MOVE = """([x, y]) => new Promise((done) => {
    const canvas = document.querySelector(".map-stage canvas");
    let moves = 0, pictures = 0;
    const seen = new MutationObserver(() => pictures++);
    seen.observe(canvas, { attributes: true, attributeFilter: ["data-triangles"] });
    const step = () => {
        const [right, down] = [80 * Math.sin(moves / 8), 20 * Math.cos(moves / 8)];
        const place = { clientX: x + right, clientY: y + down };
        const kind = { pointerId: 1, pointerType: "mouse", bubbles: true, button: -1, buttons: 2 };
        canvas.dispatchEvent(new PointerEvent("pointermove", { ...kind, ...place }));
        if (moves++ < 60) setTimeout(() => requestAnimationFrame(step), 0);
        else setTimeout(() => { seen.disconnect(); done(pictures); }, 100);
    };
    step();
})"""
"""Moves of a pressed mouse, one for each picture; how many pictures were drawn."""


def repeated(out: Path, folder: Path, frames: int, written: int) -> int:
    """Write a page with the map of a run as often as it takes for so many frames; how many frames
    it has.
    """
    shutil.copytree(out / "page", folder / "page", ignore=shutil.ignore_patterns("map"))
    shutil.copytree(out / "page/map/heights", folder / "page/map/heights")
    shutil.copy(out / "index.html", folder)
    about = content(out / "page/map/map.js")[0]
    of_one = sum(each["frames"] for each in content(out / "page/dive.js")[0]["blocks"] if each)
    edge = math.ceil(math.sqrt(frames / of_one))
    (top,) = {*about["textured"]} - {n for p in about["textured"].values() for n in p["finer"]}
    (root,) = about["textured"][top]["finer"]  # the coarsest piece with images
    low_m, high_m = about["textured"][root]["low_m"], about["textured"][root]["high_m"]
    size_m = [high - low for low, high in zip(low_m[:2], high_m[:2], strict=True)]
    level, count, of_level = 0, edge, dict[str, Any]()
    for column, row, is_written in copies(edge, written):
        offset_m = [column * size_m[0], row * size_m[1], 0.0]
        of_level |= copied(about["textured"], [root], column, row, offset_m)
        if is_written:
            write_below(out, folder, about["textured"], root, (column, row), offset_m)
    while count > 1:
        level, count, below, of_level = level + 1, -(-count // 2), of_level, {}
        start = f"{root}_" if level == 1 else f"coarse_{level - 1}_"
        for column in range(count):
            for row in range(count):
                offset_m = [
                    place * size * 2**level + corner * (1 - 2**level)
                    for place, size, corner in zip((column, row), size_m, low_m, strict=False)
                ]
                offset_m.append(0.0)
                names = [f"{start}{2 * column + i}_{2 * row + k}" for i in (0, 1) for k in (0, 1)]
                finer = {name: below[name] for name in names if name in below}
                new = f"coarse_{level}_{column}_{row}"
                of_level[new] = moved(about["textured"][root], 2**level, offset_m)
                of_level[new] |= {"finer": [*finer]}
                write(out, folder, root, new, 2**level, offset_m, finer)
    offset_m = [corner * (1 - 2**level) for corner in low_m[:2]] + [0.0]
    entry = moved(about["textured"][top], 2**level, offset_m)
    write(out, folder, top, "top", 2**level, offset_m, {})
    about["pieces"] = {"top": entry | {"finer": []}}
    about["textured"] = {"top": entry | {"finer": [*of_level]}, **of_level}
    (folder / "page/map/map.js").write_bytes(script("map", about))
    write_frames(out, folder, edge, size_m)
    write_squares(out, folder, edge, size_m)
    return of_one * edge**2


def write_frames(out: Path, folder: Path, edge: int, size_m: list[float]) -> None:
    """The dive's frames in each copy of the map, and their blocks."""
    (dive,) = content(out / "page/dive.js")
    of_one = json.loads(zlib.decompress(dive["frames"]))
    blocks = [content(path)[1] for path in numbered(out / "page/frames")]
    poses = np.concatenate(
        [np.frombuffer(each["poses"], "<f4").reshape(-1, 3, 4) for each in blocks]
    )
    places = [(column, row) for column in range(edge) for row in range(edge)]
    offsets_m = np.array(places, np.float32) * np.array(size_m, np.float32)
    all_poses = np.tile(poses, (len(places), 1, 1))
    all_poses[:, :2, 3] += np.repeat(offsets_m, len(poses), axis=0)
    count = len(places)
    frames = of_one | {
        "names": [f"{name}_{i}" for i in range(count) for name in of_one["names"]],
        **{key: of_one[key] * count for key in ("status", "shown", "shelves")},
    }
    columns = {
        plot: {
            name: [v for each in blocks for v in each["plots"][plot][name]] * count
            for name in curves
        }
        for plot, curves in dive["plots"].items()
    }
    about, scripts = blocks_of(all_poses.astype(np.float64), columns)
    shutil.rmtree(folder / "page/frames")
    (folder / "page/frames").mkdir()
    for path, written in scripts.items():
        (folder / path).write_bytes(written)
    text = json.dumps(frames, separators=(",", ":")).encode()
    dive |= {"blocks": about, "frames": zlib.compress(text, 6)}
    (folder / "page/dive.js").write_bytes(script("dive", dive))


def write_squares(out: Path, folder: Path, edge: int, size_m: list[float]) -> None:
    """The metrics of squares in each copy of the map."""
    (folder / "page/map/squares").mkdir()
    for path in numbered(out / "page/map/squares"):
        number, packed = content(path)
        places = np.array([(i, k) for i in range(edge) for k in range(edge)], np.float32)
        squares = np.frombuffer(bytes_of(packed), "<f4").reshape(-1, 4)
        all_squares = np.tile(squares, (len(places), 1))
        all_squares[:, :2] += np.repeat(places * np.array(size_m, np.float32), len(squares), axis=0)
        made = script("squares", number, all_squares.tobytes())
        (folder / f"page/map/squares/{path.name}").write_bytes(made)


def numbered(folder: Path) -> list[Path]:
    """The scripts of a folder, by their numbers."""
    return sorted(folder.glob("*.js"), key=lambda path: int(path.stem))


def copied(
    pieces: dict[str, Any], names: list[str], column: int, row: int, offset_m: list[float]
) -> dict[str, Any]:
    """The entries of some pieces in a copy of the map."""
    return {
        f"{name}_{column}_{row}": moved(pieces[name], 1, offset_m)
        | {"finer": [f"{finer}_{column}_{row}" for finer in pieces[name]["finer"]]}
        for name in names
    }


def write_below(
    out: Path,
    folder: Path,
    pieces: dict[str, Any],
    name: str,
    copy: tuple[int, int],
    offset_m: list[float],
) -> None:
    """The scripts of a piece of a copy of the map, and of those below it. pieces: of all that the
    list of the map or the script of a coarser piece has.
    """
    pieces = pieces | content(out / f"page/map/{name}.js")[-1]
    finer = copied(pieces, pieces[name]["finer"], *copy, offset_m)
    write(out, folder, name, f"{name}_{copy[0]}_{copy[1]}", 1, offset_m, finer)
    for below in pieces[name]["finer"]:
        write_below(out, folder, pieces, below, copy, offset_m)


def copies(edge: int, written: int) -> Iterator[tuple[int, int, bool]]:
    """Column and row of each copy, and whether its files are written."""
    for column in range(edge):
        for row in range(edge):
            yield column, row, max(abs(column - edge // 2), abs(row - edge // 2)) <= written


def content(path: Path) -> list[Any]:
    """The data of a script; bytes where a text holds them."""
    read = path.read_bytes()
    text = read.decode("utf-16" if read[:1] == b"\xff" else "ascii")
    return list(
        json.loads(
            f"[{text[text.index('(') + 1 : text.rindex(')')]}]",
            object_hook=lambda each: {key: bytes_of(value) for key, value in each.items()},
        )
    )


def bytes_of(value: Any) -> Any:
    """Bytes from characters of two, as stereo_seecolor/report/templates.py writes them; others as
    they are.
    """
    if not isinstance(value, str) or min(value[1:], default="") < chr(ESCAPE):
        return value
    units = np.frombuffer(value[1:].encode("utf-16-le"), "<u2").copy()
    escapes = np.flatnonzero(units == ESCAPE)
    units[escapes + 1] ^= np.uint16(MOVED)
    return np.delete(units, escapes).tobytes()[: -int(value[0]) or None]


def moved(piece: dict[str, Any], scale: int, offset_m: list[float]) -> dict[str, Any]:
    """A piece of the list, stretched along the map and moved."""
    corners = {key: placed(piece[key], scale, offset_m) for key in ("low_m", "high_m")}
    sizes = {key: scale * piece[key] for key in ("cell_m", "texel_m") if key in piece}
    return {**piece, **corners, **sizes}


def placed(point_m: list[float], scale: int, offset_m: list[float]) -> list[float]:
    """A point, stretched along the map and moved."""
    stretched = (scale * point_m[0], scale * point_m[1], point_m[2])
    return [value + off for value, off in zip(stretched, offset_m, strict=True)]


def write(
    out: Path,
    folder: Path,
    name: str,
    new: str,
    scale: int,
    offset_m: list[float],
    finer: dict[str, Any],
) -> None:
    """The script of a piece, stretched along the map and moved. finer: the pieces that it lists."""
    _, packed, _ = content(out / f"page/map/{name}.js")
    receiver = "textured" if isinstance(packed, list) else "mesh"
    for part in packed if isinstance(packed, list) else [packed]:
        part["low_m"] = placed(part["low_m"], scale, offset_m)
        part["step_m"] = [scale * part["step_m"][0], scale * part["step_m"][1], part["step_m"][2]]
    (folder / f"page/map/{new}.js").write_bytes(script(receiver, new, packed, finer))


def processes() -> dict[str, tuple[float, float]]:
    """By the kind of this process's children: processor time in seconds, and memory in MB."""
    parents, found = {}, dict[str, tuple[float, float]]()
    for process in Path("/proc").iterdir():
        if not process.name.isdigit():
            continue
        try:
            fields = (process / "stat").read_text().rsplit(")", 1)[1].split()
            kind = "".join(KIND.findall((process / "cmdline").read_text())[:1])
            memory_mb = int((process / "statm").read_text().split()[1]) * 4096 / 1e6
        except OSError:
            continue  # has ended
        parents[int(process.name)] = (
            int(fields[1]),
            kind,
            int(fields[11]) + int(fields[12]),
            memory_mb,
        )
    todo, mine = [os.getpid()], set[int]()
    while todo:
        number = todo.pop()
        children = [child for child, (parent, *_) in parents.items() if parent == number]
        mine |= {*children}
        todo += children
    for number in mine:
        _, kind, ticks, memory_mb = parents[number]
        before = found.get(kind, (0.0, 0.0))
        found[kind] = before[0] + ticks / os.sysconf("SC_CLK_TCK"), max(before[1], memory_mb)
    return found


def said(page: Page, what: str) -> None:
    """Print memory, and the processor time of a picture of a moving view."""
    box = page.locator(".map-stage").bounding_box()
    assert box
    middle = [box["x"] + box["width"] / 2, box["y"] + box["height"] / 2]
    page.mouse.move(*middle)
    page.mouse.down(button="right")
    page.evaluate(MOVE, middle)  # finds its pace
    before, start_s = processes(), time.monotonic()
    pictures = page.evaluate(MOVE, middle)
    took_s, after = time.monotonic() - start_s, processes()
    page.mouse.up(button="right")
    used_ms = 1000 * sum(after[kind][0] - before[kind][0] for kind in after if kind in before)
    rested(page)
    heap_mb = page.evaluate("performance.memory.usedJSHeapSize") / 1e6
    triangles = page.locator(".map-stage canvas").get_attribute("data-triangles")
    print(
        f"{what}: {heap_mb:.0f} MB of script, renderer {after['renderer'][1]:.0f} MB, drawing "
        f"{after['gpu-process'][1]:.0f} MB; {used_ms / pictures:.0f} ms of processor time a "
        f"picture, {pictures / took_s:.1f} pictures/s; {triangles} triangles at rest",
        flush=True,
    )


def on_reef(page: Page) -> tuple[float, float]:
    """The place of the window nearest to the middle of the map's that shows the reef, which is
    light.
    """
    stage = page.locator(".map-stage")
    encoded = np.frombuffer(stage.screenshot(), np.uint8)  # scrolls to it
    box, image = stage.bounding_box(), cv2.imdecode(encoded, cv2.IMREAD_GRAYSCALE)
    assert box and image is not None
    rows, columns = np.nonzero(np.asarray(image) > LIGHT)
    height, width = image.shape
    nearest = np.argmin(np.hypot(rows - height / 2, columns - width / 2))
    return box["x"] + float(columns[nearest]), box["y"] + float(rows[nearest])


def rested(page: Page) -> None:
    """Wait until nothing moves and all pieces of the view are loaded."""
    still = 0
    while still < 5:
        busy = page.locator(".map-stage canvas").get_attribute("aria-busy") != "false"
        still = 0 if busy else still + 1
        page.wait_for_timeout(200)


def main(out: Path, folder: Path, frames: int, written: int) -> None:
    """Draw the page, and look at it."""
    folder.mkdir()
    drawn = repeated(out, folder, frames, written)
    opened_kb = {
        name: round((folder / "page" / name).stat().st_size / 1e3)
        for name in ("dive.js", "map/map.js")
    }
    later_mb = {
        name: round(sum(p.stat().st_size for p in (folder / "page" / name).iterdir()) / 1e6, 1)
        for name in ("frames", "map/squares")
    }
    print(f"{drawn} frames; lists, kB: {opened_kb}; by need, MB: {later_mb}")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(
            executable_path=shutil.which("chromium"), args=list(SOFTWARE)
        )
        page = browser.new_page(viewport={"width": 1280, "height": 800})
        loaded = list[str]()
        page.on("request", lambda request: loaded.append(request.url))
        start_s = time.monotonic()
        page.goto(f"{(folder.resolve() / 'index.html').as_uri()}#map", wait_until="commit")
        canvas = page.locator(".map-stage canvas[data-triangles]:not([data-triangles='0'])")
        canvas.wait_for(timeout=300_000)
        print(f"first picture after {time.monotonic() - start_s:.1f} s")
        rested(page)
        print(f"all of it after {time.monotonic() - start_s:.1f} s")
        read = [Path(unquote(urlsplit(url).path)) for url in loaded]
        read_mb = sum(path.stat().st_size for path in read if path.is_file()) / 1e6
        print(f"until then {len(read)} files of {read_mb:.1f} MB were read")
        said(page, "whole map")
        box = page.locator(".map-stage").bounding_box()
        assert box
        page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
        for _ in range(int(3 + 2.5 * math.log2(frames))):  # the middle of the map stays there
            page.mouse.wheel(0, -240)
            page.wait_for_timeout(200)
            rested(page)
        page.mouse.move(*on_reef(page))
        for _ in range(3):
            page.mouse.wheel(0, -240)
            page.wait_for_timeout(200)
        rested(page)
        said(page, "near")
        for flight in range(FLIGHTS):
            x, y = on_reef(page)
            page.mouse.move(x, y)
            page.mouse.down()
            page.mouse.move(x + 300 * math.cos(flight), y + 200 * math.sin(flight), steps=5)
            page.mouse.up()
            rested(page)
        said(page, f"after {FLIGHTS} flights")
        browser.close()


if __name__ == "__main__":
    parser = parser_of(__doc__)
    parser.add_argument("out", type=Path)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--frames", type=int, default=2400)
    parser.add_argument("--written", type=int, default=3)
    given = parser.parse_args()
    main(given.out, given.folder, given.frames, given.written)
