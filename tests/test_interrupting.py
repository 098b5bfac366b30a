"""Ctrl-C and SIGTERM end what runs in threads, too: nobody waits for what nobody asks for any more."""

from __future__ import annotations

import signal
import subprocess
import sys
import threading
import time
from types import FrameType, SimpleNamespace

import pytest

from tracker.foundation.errors import ConfigError
from tracker.synthesis import side_by_side

AT_WORK = """
import sys, threading, time
import tracker.running.cli as cli

def interrupted(standalone_mode):
    threading.Thread(target=time.sleep, args=(60,)).start()
    raise KeyboardInterrupt

cli.app = interrupted
sys.argv = ["bodytrack", "run", "x.toml"]
cli.main()
"""


def test_an_interrupted_search_does_not_wait_for_its_threads() -> None:
    told = threading.Event()

    def interrupt(number: int, frame: FrameType | None) -> None:
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGALRM, interrupt)
    begin = time.monotonic()
    signal.setitimer(signal.ITIMER_REAL, 0.2)
    try:
        with pytest.raises(KeyboardInterrupt):
            side_by_side(SimpleNamespace(threads=True), lambda _: told.wait(60), range(3))
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)
        told.set()
    assert time.monotonic() - begin < 30


def test_an_error_in_a_thread_waits_for_the_others() -> None:
    done, all_at_work = [], threading.Barrier(3, timeout=30)

    def work(k: int) -> None:
        all_at_work.wait()  # what has not begun is given up
        if k == 0:
            raise ConfigError("no")
        time.sleep(0.05)
        done.append(k)

    with pytest.raises(ConfigError):
        side_by_side(SimpleNamespace(threads=True), work, range(3))
    assert sorted(done) == [1, 2]


def test_a_command_ends_when_interrupted_though_threads_are_at_work() -> None:
    process = subprocess.run([sys.executable, "-c", AT_WORK], capture_output=True, text=True, timeout=50, check=False)
    assert (process.returncode, process.stderr.strip()) == (130, "interrupted")
