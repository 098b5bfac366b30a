"""Spoils files at random and has every reader read them; what must not happen is kept as a test."""

from __future__ import annotations

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
from fuzzing.trial import Bench, ended_if_it_hangs, keep, smallest
from rich.console import Console

from tracker.synthesis.simulation.sequence import Recipe, write_sequence

_BATCH = 5000
"""Inputs of one process, which takes as long to start as 1500 of them; one that dies or hangs costs no more."""

_LONGEST_S = 3600.0
"""Real time of a process; it ends itself much earlier where an input does not come back."""

_MEMORY = 6 * 2**30
"""Address space of a process, bytes; libraries take 2 GiB of it."""

_MEMORY_DISK = Path("/dev/shm")
"""Where inputs are written: on a disk, opening files is a quarter of the time."""

console = Console()


def spoil(
    minutes: Annotated[float, typer.Option(min=0, help="How long.")] = 1.0,
    seed: Annotated[int, typer.Option(min=0, help="Chooses what is spoilt.")] = 0,
    only: Annotated[str, typer.Option(help="Readers whose name begins so.")] = "",
    batch: Annotated[int, typer.Option(hidden=True)] = -1,
) -> None:
    """Spoils files for every reader: `python scripts/fuzz.py readers --minutes 30 --seed 1`.

    `scripts/sanitized.sh .venv/bin/python scripts/fuzz.py readers` has the kernels checked as well.
    """
    if batch >= 0:
        _work(seed, batch, only)
        return
    begin, k, n_inputs = time.monotonic(), 0, 0
    faults: Counter[str] = Counter()
    while time.monotonic() < begin + 60 * minutes:
        told, n_tried = _run(seed, k, only)
        n_inputs += n_tried
        for line in told:
            if not faults[line]:
                console.print(line, style="red", highlight=False, markup=False)
            faults[line] += 1
        k += 1
    taken = f"{(time.monotonic() - begin) / 60:.0f} minutes, {_children_s() / 60:.0f} of them the processor's"
    console.print(f"{n_inputs} inputs, {len(faults)} kinds of fault in {sum(faults.values())}; seed {seed}; {taken}")
    raise typer.Exit(1 if faults else 0)


def kills(
    n: Annotated[int, typer.Option(min=1, help="Kills.")] = 50,
    seed: Annotated[int, typer.Option(min=0, help="Chooses the instants.")] = 0,
) -> None:
    """Kills runs with -9 at random instants and resumes them: `python scripts/fuzz.py kills --n 50`.

    Every second one writes each frame at once (`passes = 1`); of the others a kill takes the whole window.
    """
    rng, done, anew = random.Random(seed), 0, 0
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        config = write_sequence(Recipe("arm_swing", seconds=0.4, size=(256, 208)), folder / "sequence")
        text = config.read_text(encoding="utf-8")
        seconds = []
        for passes in (1, 2):
            config.with_name(f"passes{passes}.toml").write_text(f"passes = {passes}\n{text}", encoding="utf-8")
            seconds.append(left_alone(config.with_name(f"passes{passes}.toml"), folder / f"whole{passes}"))
        for k in range(-(-n // 10)):
            passes = 1 + k % 2
            one = config.with_name(f"passes{passes}.toml")
            found = killed(one, folder / f"killed{k}", min(10, n - done), rng, seconds[passes - 1])
            fault = found.fault or difference(folder / f"whole{passes}", folder / f"killed{k}")
            done, anew = done + found.n_kills, anew + found.n_anew
            told = f"{done} kills, {anew} before anything was computed, passes = {passes}: {fault or 'same bytes'}"
            console.print(told)
            if fault:
                raise typer.Exit(1)


def _children_s() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def _run(seed: int, batch: int, only: str) -> tuple[list[str], int]:
    """The faults that a process of its own has found, a line each, and how many inputs it has tried."""
    command = [sys.executable, __file__, "readers", "--seed", str(seed), "--batch", str(batch), "--only", only]
    with tempfile.TemporaryDirectory(dir=_MEMORY_DISK if _MEMORY_DISK.is_dir() else None) as folder:
        scratch = {**os.environ, "TMPDIR": folder}
        try:
            done = subprocess.run(command, capture_output=True, text=True, timeout=_LONGEST_S, env=scratch, check=False)
        except subprocess.TimeoutExpired as error:
            return [f"hangs: {_last(error.stdout)}"], 0
    found = [line.removeprefix("fault: ") for line in done.stdout.splitlines() if line.startswith("fault: ")]
    if done.returncode != 0:
        found.append(f"ended with {done.returncode}: {_last(done.stdout)}: {done.stderr.strip()[-300:]}")
    return found, sum(line.startswith("input ") for line in done.stdout.splitlines())


def _last(output: str | bytes | None) -> str:
    """The input at work when a process ended."""
    text = output.decode(errors="replace") if isinstance(output, bytes) else output or ""
    return text.strip().rpartition("\n")[2]


def _work(seed: int, batch: int, only: str) -> None:
    """Tries a batch of inputs; each is named before it is tried, in case it is the last one."""
    if "libasan" not in os.environ.get("LD_PRELOAD", ""):  # whose shadow of the memory is 16 TiB of addresses
        resource.setrlimit(resource.RLIMIT_AS, (_MEMORY, _MEMORY))
    rng = random.Random(f"{seed} {batch}")
    with tempfile.TemporaryDirectory() as folder:
        benches = [Bench(reader, Path(folder)) for reader in readers() if reader.name.startswith(only)]
        chosen = rng.choices(benches, [bench.reader.share for bench in benches], k=_BATCH)
        for n, bench in enumerate(chosen):
            name, content = bench.spoilt(rng)
            print(f"input {seed} {batch} {n}: {bench.reader.name} {name}", flush=True)  # noqa: T201
            with ended_if_it_hangs():
                fault = bench.trial(name, content)
            if fault is not None:
                print(f"fault: {fault.reader}, {fault.file}: {fault.kind}", flush=True)  # noqa: T201
                print(fault.told, file=sys.stderr)  # noqa: T201
                keep(smallest(bench, fault))


if __name__ == "__main__":
    app = typer.Typer(pretty_exceptions_enable=False)
    app.command("readers")(spoil)
    app.command()(kills)
    app()
