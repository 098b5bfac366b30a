"""A headless Chromium, driven through a pipe (Chrome DevTools Protocol): no library, no network."""

from __future__ import annotations

import base64
import itertools
import json
import os
import select
import shutil
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

PROGRAM = next(
    (found for name in ("chromium", "chromium-browser", "google-chrome") if (found := shutil.which(name))), None
)
_FLAGS = [
    "--headless=new",
    "--no-sandbox",
    "--disable-dev-shm-usage",
    "--enable-unsafe-swiftshader",
    "--use-angle=swiftshader",
    "--window-size=1100,1000",
    "--remote-debugging-pipe",
]


class Browser:
    """An open page."""

    def __init__(self, commands: int, answers: int) -> None:
        self._commands, self._answers, self._numbers = commands, answers, itertools.count(1)
        self._rest, self._session = b"", ""
        self.errors: list[str] = []
        target = self._ask("Target.createTarget", url="about:blank")["targetId"]
        self._session = self._ask("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        for domain in ("Runtime", "Page"):
            self._ask(f"{domain}.enable")

    def _ask(self, method: str, **parameters: Any) -> Any:
        number = next(self._numbers)
        told = {"id": number, "method": method, "params": parameters}
        os.write(
            self._commands, json.dumps(told | ({"sessionId": self._session} if self._session else {})).encode() + b"\0"
        )
        while True:
            message = self._next()
            if message.get("method") == "Runtime.exceptionThrown":
                self.errors.append(json.dumps(message["params"]["exceptionDetails"])[:400])
            if message.get("id") == number:
                assert "error" not in message, message
                return message["result"]

    def _next(self) -> Any:
        while b"\0" not in self._rest:
            ready, _, _ = select.select([self._answers], [], [], 60)
            assert ready, "the browser does not answer"
            self._rest += os.read(self._answers, 2**20)
        message, _, self._rest = self._rest.partition(b"\0")
        return json.loads(message)

    def open(self, address: str) -> None:
        """Goes to a page."""
        self._ask("Page.navigate", url=address)

    def value(self, expression: str) -> Any:
        """What JavaScript says."""
        return self._ask("Runtime.evaluate", expression=expression, returnByValue=True)["result"].get("value")

    def wait(self, expression: str, seconds: float = 60) -> Any:
        """Asks until the answer is true."""
        end = time.monotonic() + seconds
        while not (value := self.value(expression)):
            assert time.monotonic() < end, f"{expression} never came true; {self.errors}"
            time.sleep(0.1)
        return value

    def picture(self, path: Path) -> None:
        """Takes a picture of what is seen."""
        path.write_bytes(base64.b64decode(self._ask("Page.captureScreenshot")["data"]))


@contextmanager
def browser(profile: Path) -> Iterator[Browser]:
    """A browser of its own.

    Args:
        profile: folder for what it keeps.
    """
    theirs_in, commands = os.pipe()
    answers, theirs_out = os.pipe()

    def pipes() -> None:  # the browser reads commands from 3 and answers to 4
        os.dup2(theirs_in, 200)
        os.dup2(theirs_out, 201)
        os.dup2(200, 3)
        os.dup2(201, 4)

    process = subprocess.Popen(
        [str(PROGRAM), *_FLAGS, f"--user-data-dir={profile}"],
        pass_fds=(3, 4, theirs_in, theirs_out),
        preexec_fn=pipes,
        stderr=subprocess.DEVNULL,
    )
    try:
        yield Browser(commands, answers)
    finally:
        process.kill()
        process.wait()
        for end in (theirs_in, commands, answers, theirs_out):
            os.close(end)
