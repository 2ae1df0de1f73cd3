"""A page on this machine that shows the last corrected pair: picture, range, the water, latency and counts."""

import json
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.compute.background import in_background
from stereo_seecolor.errors import OutputError
from stereo_seecolor.files.decode import eight_bit
from stereo_seecolor.live.processing import LiveFrame
from stereo_seecolor.live.session import LiveCounts

HOST = "127.0.0.1"
"""Only this machine: the page has no password."""

WIDTH_PX, QUALITY = 960, 85
SLOW_CLIENT_S = 5.0

PAGE = """<!doctype html><html lang="en"><meta charset="utf-8"><title>stereo-seecolor live</title>
<meta name="viewport" content="width=device-width">
<style>body{font:15px system-ui,sans-serif;margin:1em;background:#111;color:#eee}
div{display:flex;flex-wrap:wrap;gap:1em}img{width:100%;background:#222;min-height:8em}figure{margin:0;flex:1 1 28em}
table{border-spacing:1em 0}td:last-child{text-align:right;font-variant-numeric:tabular-nums}#error{color:#fa8}</style>
<h1>Live</h1><p id="state">waiting for the first pair</p><p id="error"></p>
<div><figure><img id="corrected" alt="last corrected image"><figcaption>Corrected</figcaption></figure>
<figure><img id="range" alt="its range map"><figcaption id="span">Range</figcaption></figure></div>
<table id="facts"></table>
<script>
let shown = "";
async function look() {
  try {
    const status = await (await fetch("status.json")).json();
    const waiting = status.waiting ? "waiting for " + status.waiting : status.name || "waiting for the first pair";
    document.getElementById("state").textContent = waiting;
    document.getElementById("error").textContent = status.last_error;
    document.getElementById("span").textContent = "Range" + (status.range_span || "");
    const table = document.getElementById("facts");
    table.replaceChildren(...Object.entries(status.facts).map(([name, value]) => {
      const row = document.createElement("tr");
      for (const text of [name, value]) row.appendChild(document.createElement("td")).textContent = text;
      return row;
    }));
    if (status.name && status.name !== shown) {
      shown = status.name;
      for (const id of ["corrected", "range"]) document.getElementById(id).src = id + ".jpg?" + encodeURIComponent(shown);
    }
  } catch (error) { document.getElementById("state").textContent = "the program has ended"; }
  setTimeout(look, 500);
}
look();
</script></html>
"""


class Preview:
    """What the page shows. ``update`` replaces it as a whole, so that a browser never sees half of a pair."""

    def __init__(self, counts: LiveCounts) -> None:
        self._counts = counts
        self._shown: tuple[dict[str, Any], dict[str, bytes]] = ({"name": "", "facts": {}}, {})

    def update(self, frame: LiveFrame) -> None:
        """The page shows this pair from now on."""
        correction, range_m = frame.result.correction, frame.result.range_map.measured_m
        range_picture, span = _range_picture(range_m)
        pictures = {"corrected.jpg": _jpeg(eight_bit(correction.image)), "range.jpg": _jpeg(range_picture)}
        water = {f"water: {name}": ", ".join(f"{v:.3g}" for v in np.ravel(values)) for name, values in _parameters(frame).items()}
        facts = {
            "seconds a pair": f"{frame.seconds:.2f}",
            "range known": f"{np.isfinite(range_m).mean():.0%}",
            **water,
        }
        self._shown = ({"name": frame.pair.name, "range_span": span, "facts": facts}, pictures)

    def status(self) -> dict[str, Any]:
        """As the page's script reads it."""
        shown, counts = self._shown[0], self._counts.facts()
        latencies = {f"latency, {kind}": counts[f"latency_{kind}_s"] for kind in ("median", "p95")}
        counted = {name: str(counts[name]) for name in ("done", "failed", "dropped")}
        times = {name: f"{value:.2f} s" for name, value in latencies.items() if value is not None}
        return {**shown, "facts": {**counted, **times, **shown["facts"]}, **{k: counts[k] for k in ("waiting", "last_error")}}

    def content(self, path: str) -> tuple[str, bytes] | None:
        """(media type, content) of what a browser asks for; None for what there is not."""
        name = path.split("?")[0].lstrip("/")
        if name == "":
            return "text/html; charset=utf-8", PAGE.encode()
        if name == "status.json":
            return "application/json", json.dumps(self.status()).encode()
        picture = self._shown[1].get(name)
        return ("image/jpeg", picture) if picture else None


@contextmanager
def served(preview: Preview, port: int) -> Iterator[str]:
    """Serve the page on this machine while the block runs; its address. port: 0 takes any that is free.

    Raises OutputError if the port is taken.
    """

    class Handler(BaseHTTPRequestHandler):
        timeout = SLOW_CLIENT_S

        def do_GET(self) -> None:
            """Answer a browser."""
            found = preview.content(self.path) if self._is_local() else None
            self.send_response(200 if found else 404)
            media_type, content = found or ("text/plain", b"not here\n")
            for name, value in (("Content-Type", media_type), ("Content-Length", str(len(content))), ("Cache-Control", "no-store")):
                self.send_header(name, value)
            self.end_headers()
            self.wfile.write(content)

        def _is_local(self) -> bool:
            """Other sites must not read the page through a name of theirs that leads here."""
            return self.headers.get("Host", "").rsplit(":", 1)[0] in (HOST, "localhost")

        def log_message(self, format: str, *args: Any) -> None:
            """Requests are not logged."""

    try:
        server = ThreadingHTTPServer((HOST, port), Handler)
    except (OSError, OverflowError) as error:
        raise OutputError(f"http://{HOST}:{port}: the page cannot be served there ({error}): choose another --port") from error
    with server, in_background(server.serve_forever, server.shutdown):
        yield f"http://{HOST}:{server.server_address[1]}/"


def _parameters(frame: LiveFrame) -> dict[str, Any]:
    water = frame.result.correction.water
    return {name: value for name, value in vars(water).items() if isinstance(value, np.ndarray) and value.size == 3}


def _range_picture(range_m: NDArray[np.float32]) -> tuple[NDArray[np.uint8], str]:
    """Near is bright, unknown is black; the span in words."""
    known = np.isfinite(range_m)
    if not known.any():
        return np.zeros((*range_m.shape, 3), np.uint8), ": unknown everywhere"
    near_m, far_m = np.quantile(range_m[known], (0.02, 0.98))
    scaled = np.clip((far_m - np.where(known, range_m, far_m)) / max(far_m - near_m, 1e-3), 0, 1)
    colored = cv2.applyColorMap((255 * scaled).astype(np.uint8), cv2.COLORMAP_VIRIDIS)[..., ::-1] * known[..., None]
    return colored.astype(np.uint8), f", {near_m:.2f} m (yellow) to {far_m:.2f} m (blue)"


def _jpeg(image: NDArray[np.uint8]) -> bytes:
    height, width = image.shape[:2]
    if width > WIDTH_PX:
        image = cv2.resize(image, (WIDTH_PX, round(height * WIDTH_PX / width)), interpolation=cv2.INTER_AREA)
    return bytes(cv2.imencode(".jpg", image[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, QUALITY])[1])
