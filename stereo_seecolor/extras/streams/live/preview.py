"""A web page from this machine: the last corrected pair, range, water, latency and counts."""

import json
import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cached_property
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.compute.background import running
from stereo_seecolor.errors import OutputError
from stereo_seecolor.extras.streams.live.processing import LiveFrame
from stereo_seecolor.extras.streams.live.session import LiveCounts
from stereo_seecolor.files.previews import PreviewSize, preview, range_picture
from stereo_seecolor.report.texts import STATIC

HOST = "127.0.0.1"
LOCAL = (HOST, "localhost")
"""Addresses that only this machine can reach, so that the page needs no token."""

TOKEN_BYTES = 16
HEADERS = (
    ("Cache-Control", "no-store"),
    ("Referrer-Policy", "no-referrer"),
    ("X-Content-Type-Options", "nosniff"),
)
"""No-referrer keeps the token in the address from other sites."""

SIZE = PreviewSize(960, 85)
SLOW_CLIENT_S = 5.0

PAGE = Path(__file__).with_name("preview.html")
STYLE = "page.css"
"""The page of a run and this one look alike."""
COUNTS = {"done": "Pairs corrected", "failed": "Failed", "dropped": "Skipped for newer pairs"}
DELAYS = {"latency": "From arrival to image", "products": "Until all files are written"}


class _Shown:
    """One pair on the page; its images are encoded when a browser asks for them."""

    def __init__(self, frame: LiveFrame) -> None:
        self._frame = frame

    @cached_property
    def ranges(self) -> tuple[NDArray[np.uint8], str]:
        picture, near_m, far_m = range_picture(self._frame.result.range_map.measured_m)
        span = (
            f", {near_m:.2f} m (yellow) to {far_m:.2f} m (blue)"
            if np.isfinite(near_m)
            else ": unknown everywhere"
        )
        return picture, span

    def picture(self, name: str) -> bytes | None:
        if name == "corrected.jpg":
            return preview(self._frame.result.correction.image, SIZE)
        return preview(self.ranges[0], SIZE) if name == "range.jpg" else None

    @cached_property
    def status(self) -> dict[str, Any]:
        known = np.isfinite(self._frame.result.range_map.measured_m).mean()
        water = self._frame.result.correction.water
        near_m = np.array(1.0)
        red, _, blue = water.white / water.white[1]
        facts = {
            "Range known": f"{known:.0%}",
            "Time for the pair": f"{self._frame.seconds:.2f} s",
            "Light that remains after 1 m, R G B": _percents(water.attenuation(near_m)),
            "Backscatter over 1 m, R G B, of full scale": _percents(water.backscatter(near_m)),
            "White point, red and blue over green": f"{red:.2f}, {blue:.2f}",
        }
        return {
            "name": self._frame.pair.name,
            "range_span": self.ranges[1],
            "pair": facts,
            "warnings": list(self._frame.result.warnings),
        }


class Preview:
    """The page's content. ``update`` replaces it at once: no browser sees parts of two pairs."""

    def __init__(self, counts: LiveCounts) -> None:
        self._counts = counts
        self._shown: _Shown | None = None

    def update(self, frame: LiveFrame) -> None:
        """Show this pair from now on."""
        self._shown = _Shown(frame)

    def status(self) -> dict[str, Any]:
        """The status that the page's script reads."""
        shown: dict[str, Any] = (
            self._shown.status if self._shown else {"name": "", "pair": {}, "warnings": []}
        )
        counts = self._counts.facts()
        facts = {words: str(counts[name]) for name, words in COUNTS.items()}
        for name, words in DELAYS.items():
            median_s, p95_s = counts[f"{name}_median_s"], counts[f"{name}_p95_s"]
            if median_s is not None:
                facts[words] = f"{median_s:.2f} s (95 % within {p95_s:.2f} s)"
        notes = {name: counts[name] for name in ("waiting", "last_error", "reduced")}
        return {**shown, "facts": facts, **notes}

    def content(self, path: str) -> tuple[str, bytes] | None:
        """(media type, content) of a path that a browser asks for; None for unknown ones."""
        name = path.split("?")[0].lstrip("/")
        if name == "":
            return "text/html; charset=utf-8", PAGE.read_bytes()
        if name == STYLE:
            return "text/css; charset=utf-8", (STATIC / STYLE).read_bytes()
        if name == "status.json":
            return "application/json", json.dumps(self.status()).encode()
        picture = self._shown.picture(name) if self._shown else None
        return ("image/jpeg", picture) if picture else None


@contextmanager
def served(preview: Preview, port: int, host: str = HOST) -> Iterator[str]:
    """Serve the page while the block runs; yields its URL. port: 0 takes any free port.

    host: an address of this machine that the page is bound to. If other machines can reach it,
    paths begin with a random token, and all others are refused. Raises OutputError if the port is
    taken, or the address is not one of this machine.
    """
    token = "" if host in LOCAL else f"{secrets.token_urlsafe(TOKEN_BYTES)}/"

    class Handler(BaseHTTPRequestHandler):
        timeout = SLOW_CLIENT_S

        def do_GET(self) -> None:
            """Answer a browser."""
            found = preview.content(self.path[1 + len(token) :]) if self._is_allowed() else None
            self.send_response(200 if found else 404)
            media_type, content = found or ("text/plain", b"not here\n")
            for name, value in (
                ("Content-Type", media_type),
                ("Content-Length", str(len(content))),
                *HEADERS,
            ):
                self.send_header(name, value)
            self.end_headers()
            self.wfile.write(content)

        def _is_allowed(self) -> bool:
            """True with the token, or from this machine: other sites must not read the page."""
            if token:
                return secrets.compare_digest(
                    self.path[: 1 + len(token)].encode(), f"/{token}".encode()
                )
            return self.headers.get("Host", "").rsplit(":", 1)[0] in LOCAL

        def log_message(self, format: str, *args: Any) -> None:
            """Requests are not logged."""

    try:
        server = ThreadingHTTPServer((host, port), Handler)
    except (OSError, OverflowError) as error:
        raise OutputError(
            f"http://{host}:{port}: the page cannot be served there ({error}): choose another "
            "--port"
        ) from error
    with server, running(server.serve_forever, server.shutdown):
        yield f"http://{host}:{server.server_address[1]}/{token}"


def _percents(fractions: NDArray[np.float64]) -> str:
    return ", ".join(f"{100 * value:.2g}" for value in fractions.ravel()) + " %"
