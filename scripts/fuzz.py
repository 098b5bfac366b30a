"""Spoils files at random and has every reader read them; what must not happen is kept as a test."""

from __future__ import annotations

import hashlib
import os
import random
import resource
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path
from typing import Annotated

os.environ.setdefault("OPENCV_LOG_LEVEL", "OFF")
os.environ.setdefault("OPENCV_IO_MAX_IMAGE_PIXELS", str(2**28))

import typer
from fuzzing.kills import difference, killed, left_alone
from fuzzing.readers import readers
from fuzzing.trial import Bench, Fault, smallest
from rich.console import Console

from tracker.simulation.sequence import Recipe, write_sequence

KEPT = Path(__file__).resolve().parents[1] / "tests" / "fuzz" / "kept"

_BATCH = 2000
"""Inputs of one process: one that dies or hangs costs no more."""

_HANGS_S = 600.0
"""Real time of a process after which the input at work is what it hangs on."""

_MEMORY = 6 * 2**30
"""Address space of a process, bytes; libraries take 2 GiB of it."""

console = Console()


def spoil(
    minutes: Annotated[float, typer.Option(min=0, help="How long.")] = 1.0,
    seed: Annotated[int, typer.Option(min=0, help="Chooses what is spoilt.")] = 0,
    only: Annotated[str, typer.Option(help="Readers whose name begins so.")] = "",
    batch: Annotated[int, typer.Option(hidden=True)] = -1,
) -> None:
    """Spoils files for every reader: `python scripts/fuzz.py readers --minutes 30 --seed 1`."""
    if batch >= 0:
        _work(seed, batch, only)
        return
    end, k, n_inputs = time.monotonic() + 60 * minutes, 0, 0
    faults: Counter[str] = Counter()
    while time.monotonic() < end:
        told = _run(seed, k, only)
        n_inputs += _BATCH
        for line in told:
            if not faults[line]:
                console.print(line, style="red", highlight=False, markup=False)
            faults[line] += 1
        k += 1
    console.print(f"{n_inputs} inputs, {len(faults)} kinds of fault in {sum(faults.values())}; seed {seed}")
    raise typer.Exit(1 if faults else 0)


def kills(
    n: Annotated[int, typer.Option(min=1, help="Kills.")] = 50,
    seed: Annotated[int, typer.Option(min=0, help="Chooses the instants.")] = 0,
) -> None:
    """Kills runs with -9 at random instants and resumes them: `python scripts/fuzz.py kills --n 50`."""
    rng, done, anew = random.Random(seed), 0, 0
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        config = write_sequence(Recipe("arm_swing", seconds=0.4, size=(256, 208)), folder / "sequence")
        seconds = left_alone(config, folder / "whole")
        for k in range(-(-n // 10)):
            found = killed(config, folder / f"killed{k}", min(10, n - done), rng, seconds)
            fault = found.fault or difference(folder / "whole", folder / f"killed{k}")
            done, anew = done + found.n_kills, anew + found.n_anew
            console.print(f"{done} kills, {anew} before anything was computed: {fault or 'same bytes'}")
            if fault:
                raise typer.Exit(1)


def _run(seed: int, batch: int, only: str) -> list[str]:
    """The faults that a process of its own has found, a line each."""
    command = [sys.executable, __file__, "readers", "--seed", str(seed), "--batch", str(batch), "--only", only]
    with tempfile.TemporaryDirectory() as folder:
        scratch = {**os.environ, "TMPDIR": folder}
        try:
            done = subprocess.run(command, capture_output=True, text=True, timeout=_HANGS_S, env=scratch, check=False)
        except subprocess.TimeoutExpired as error:
            return [f"hangs: {_last(error.stdout)}"]
    found = [line.removeprefix("fault: ") for line in done.stdout.splitlines() if line.startswith("fault: ")]
    if done.returncode != 0:
        found.append(f"ended with {done.returncode}: {_last(done.stdout)}: {done.stderr.strip()[-300:]}")
    return found


def _last(output: str | bytes | None) -> str:
    """The input at work when a process ended."""
    text = output.decode(errors="replace") if isinstance(output, bytes) else output or ""
    return text.strip().rpartition("\n")[2]


def _work(seed: int, batch: int, only: str) -> None:
    """Tries a batch of inputs; each is named before it is tried, in case it is the last one."""
    resource.setrlimit(resource.RLIMIT_AS, (_MEMORY, _MEMORY))
    rng = random.Random(f"{seed} {batch}")
    with tempfile.TemporaryDirectory() as folder:
        benches = [Bench(reader, Path(folder)) for reader in readers() if reader.name.startswith(only)]
        for n in range(_BATCH):
            bench = rng.choice(benches)
            name, content = bench.spoilt(rng)
            print(f"input {seed} {batch} {n}: {bench.reader.name} {name}", flush=True)  # noqa: T201
            fault = bench.trial(name, content)
            if fault is not None:
                print(f"fault: {fault.reader}, {fault.file}: {fault.kind}", flush=True)  # noqa: T201
                print(fault.told, file=sys.stderr)  # noqa: T201
                _keep(smallest(bench, fault))


def _keep(fault: Fault) -> None:
    """Files the input where tests look for it, once for each kind of fault."""
    name = hashlib.sha256(f"{fault.reader} {fault.kind}".encode()).hexdigest()[:10]
    folder = KEPT / fault.reader.replace(" ", "_")
    path = folder / f"{name}--{fault.file.replace('/', '--')}"
    if path.exists() and path.stat().st_size <= len(fault.content):
        return
    folder.mkdir(parents=True, exist_ok=True)
    path.write_bytes(fault.content)


if __name__ == "__main__":
    app = typer.Typer(pretty_exceptions_enable=False)
    app.command("readers")(spoil)
    app.command()(kills)
    app()
