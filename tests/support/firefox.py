"""Firefox for the tests of the page, driven by WebDriver BiDi itself: Playwright drives only its
own build of it.
"""

import json
import re
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from websockets.sync.client import ClientConnection, connect

START_S = 60.0
_LISTENS = re.compile(r"WebDriver BiDi listening on (ws://\S+)")


@dataclass
class Firefox:
    """A tab. complaints: errors on its console, and addresses that it asked a network for."""

    socket: ClientConnection
    complaints: list[str] = field(default_factory=list)
    tab: str = ""
    _number: int = 0

    def send(self, method: str, **parameters: Any) -> dict[str, Any]:
        """A command and its result; what the browser reports meanwhile is noted."""
        self._number += 1
        self.socket.send(json.dumps({"id": self._number, "method": method, "params": parameters}))
        while True:
            message = json.loads(self.socket.recv(timeout=START_S))
            if message.get("id") == self._number:
                assert message["type"] == "success", message
                result: dict[str, Any] = message["result"]
                return result
            self._note(message)

    def _note(self, message: dict[str, Any]) -> None:
        parameters = message.get("params", {})
        if message.get("method") == "log.entryAdded" and parameters.get("level") == "error":
            self.complaints.append(str(parameters.get("text")))
        if message.get("method") == "network.beforeRequestSent":
            address = parameters["request"]["url"]
            if not address.startswith(
                ("file:", "data:", "blob:", "about:", "resource:", "chrome:")
            ):
                self.complaints.append(address)

    def open(self, address: str) -> None:
        """Load a page and wait for it."""
        self.send("browsingContext.navigate", context=self.tab, url=address, wait="complete")

    def ask(self, expression: str) -> Any:
        """The value of an expression in the page."""
        target = {"context": self.tab}
        found = self.send(
            "script.evaluate", expression=expression, target=target, awaitPromise=True
        )
        assert found["type"] == "success", found
        return found["result"].get("value")

    def click(self, *places: tuple[float, float]) -> None:
        """Click places of the window with the mouse, one after the other; twice the same place is a
        double click.
        """
        actions: list[dict[str, Any]] = []
        for x, y in places:
            actions += [{"type": "pointerMove", "x": round(x), "y": round(y)}]
            actions += [{"type": "pointerDown", "button": 0}, {"type": "pointerUp", "button": 0}]
        mouse = {
            "type": "pointer",
            "id": "mouse",
            "parameters": {"pointerType": "mouse"},
            "actions": actions,
        }
        self.send("input.performActions", context=self.tab, actions=[mouse])

    def until(self, condition: str, seconds: float = 120.0) -> None:
        """Wait until an expression is true."""
        end_s = time.monotonic() + seconds
        while not self.ask(condition):
            assert time.monotonic() < end_s, condition
            time.sleep(0.1)


@contextmanager
def firefox(program: str, profile: Path) -> Iterator[Firefox]:
    """Firefox without a window, with a new profile."""
    profile.mkdir()
    command = [
        program,
        "--headless",
        "--no-remote",
        "--profile",
        str(profile),
        "--remote-debugging-port",
        "0",
    ]
    with subprocess.Popen(
        command, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True
    ) as process:
        try:
            assert process.stderr
            address = next(found[1] for line in process.stderr if (found := _LISTENS.search(line)))
            with connect(f"{address}/session", max_size=None, compression=None) as socket:
                browser = Firefox(socket)
                browser.send("session.new", capabilities={})
                browser.tab = browser.send("browsingContext.getTree")["contexts"][0]["context"]
                browser.send(
                    "session.subscribe", events=["log.entryAdded", "network.beforeRequestSent"]
                )
                yield browser
                browser.send("browser.close")
        finally:
            process.terminate()
