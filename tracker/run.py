"""What a configuration describes, and its execution."""

from __future__ import annotations

import contextlib
import hashlib
import logging
import platform
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, Protocol

from tracker.arrays import Image
from tracker.body import BodyModel
from tracker.body_files import load_body
from tracker.config import Table, build, build_class, describe, expanded, read_config
from tracker.cycle import Cycle, LossRule
from tracker.errors import ConfigError, ModelError, SequenceError, TrackerError, nearest
from tracker.estimation import Estimation
from tracker.evidence import Evidence
from tracker.initialization import Initialization
from tracker.prediction import Prediction
from tracker.reading import Reading
from tracker.recording import Recorder, Recording, RunContext, chosen_recordings
from tracker.recording.journal import read_journal
from tracker.resources import model_path
from tracker.scene import Person, Scene
from tracker.synthesis import Synthesis
from tracker.tracking import track
from tracker.trajectory import Step

_DEFAULTS = {
    "synthesis": "cpu",
    "evidence": "contours",
    "prediction": "polynomial",
    "estimation": "hybrid",
    "initialization": "pca",
}

log = logging.getLogger("tracker")


@dataclass(frozen=True)
class Subject:
    """A person of a run: a name and a body model."""

    name: str
    model: Path
    stature_m: float | None = None
    """Height the model is scaled to, metres; None leaves it as it is."""

    def body(self) -> BodyModel:
        """The body model, scaled.

        Raises:
            ModelError: the model file is wrong.
        """
        body = load_body(self.model)
        if self.stature_m is None:
            return body
        if body.stature_m <= 0:
            raise ConfigError(f'person "{self.name}": stature_m given, but {self.model} does not tell its own')
        return load_body(self.model, self.stature_m / body.stature_m)


@dataclass(frozen=True)
class Run:
    """A tracking run: components and persons, everything that a result depends on."""

    name: str
    reading: Reading
    persons: tuple[Subject, ...]
    synthesis: Synthesis
    evidence: Evidence
    prediction: Prediction
    estimation: Estimation
    initialization: Initialization
    loss: LossRule
    recordings: tuple[Recording, ...]

    def described(self) -> Table:
        """The resolved configuration; it loads again to an equal run."""
        table: Table = {"name": self.name, "persons": [_described_subject(p) for p in self.persons]}
        for stage in ("reading", *_DEFAULTS):
            table[stage] = describe(getattr(self, stage))
        table["loss"] = {key: value for key, value in describe(self.loss).items() if key != "use"}
        table["recordings"] = [describe(recording) for recording in self.recordings]
        return table


@dataclass(frozen=True)
class RunResult:
    """What a run left."""

    folder: Path
    n_frames: int
    n_lost: int
    seconds: float
    interrupted: bool = False
    files: tuple[Path, ...] = ()
    """What the recorders have left in the folder."""


class Observer(Protocol):
    """Told how a run goes on."""

    def started(self, run: Run, n_frames: int, folder: Path) -> None:
        """Before the first frame."""

    def stepped(self, step: Step) -> None:
        """After each frame."""

    def told(self, message: str) -> None:
        """Between frames, when something takes long."""


@dataclass
class SilentObserver:
    """Says nothing."""

    messages: list[str] = field(default_factory=list)

    def started(self, run: Run, n_frames: int, folder: Path) -> None:
        """Says nothing."""

    def stepped(self, step: Step) -> None:
        """Says nothing."""

    def told(self, message: str) -> None:
        """Keeps the message."""
        self.messages.append(message)


def load_run(path: Path, overrides: Sequence[str] = ()) -> Run:
    """Reads a run's configuration.

    Args:
        path: TOML file; relative paths in it start at its folder.
        overrides: `section.key=value`.

    Raises:
        ConfigError: names file, section, key and the nearest valid one.
    """
    return run_from(read_config(path, overrides), path.name, path.parent, path.stem)


def run_from(table: Table, source: str, folder: Path, name: str) -> Run:
    """A run from a configuration table; `source` names it in messages, `folder` is where paths start."""
    sections = ("name", "reading", "persons", *_DEFAULTS, "loss", "recordings")
    for key in table:
        if key not in sections:
            raise ConfigError(f'{source}: unknown section "{key}"; {nearest(key, sections)}')
    for key in ("reading", "persons"):
        if key not in table:
            raise ConfigError(f"{source}: the section [{key}] is missing; see configs/minimal.toml")
    for key in ("reading", *_DEFAULTS, "loss"):
        if not isinstance(table.get(key, {}), dict):
            raise ConfigError(f"{source}: [{key}] is {table[key]!r}, expected a table")
    stages = {
        stage: build(stage, table.get(stage, {}), f"{source} [{stage}]", folder, default)
        for stage, default in (("reading", None), *_DEFAULTS.items())
    }
    recordings = chosen_recordings(table.get("recordings", {}), f"{source} [recordings]", folder)
    loss = build_class(LossRule, table.get("loss", {}), f"{source} [loss]", folder)
    persons = _subjects(table["persons"], source, folder)
    return Run(name=str(table.get("name", name)), persons=persons, loss=loss, recordings=recordings, **stages)


def _subjects(entries: Any, source: str, folder: Path) -> tuple[Subject, ...]:
    if not isinstance(entries, list) or not entries:
        raise ConfigError(f'{source}: persons: expected a list like [{{ name = "subject", model = "gavrila22" }}]')
    keys = ("name", "model", "stature_m")
    subjects: list[Subject] = []
    for k, entry in enumerate(entries):
        for key in entry:
            if key not in keys:
                raise ConfigError(f'{source} persons: unknown key "{key}"; {nearest(key, keys)}')
        model, stature = str(entry.get("model", "gavrila22")), entry.get("stature_m")
        if stature is not None and (not isinstance(stature, (int, float)) or not 0.2 < stature < 5):
            raise ConfigError(f"{source} persons: stature_m = {stature!r}, expected a height in metres")
        named = model.endswith(".toml")
        try:
            path = folder / expanded(model, f"{source} persons") if named else model_path(model)
        except ModelError as error:
            raise ConfigError(f"{source} persons: {error}") from error
        name = str(entry.get("name", f"person{k + 1}"))
        if name in (subject.name for subject in subjects):
            raise ConfigError(f'{source} persons: two persons are called "{name}"')
        subjects.append(Subject(name, path, stature))
    return tuple(subjects)


def _described_subject(subject: Subject) -> Table:
    table: Table = {"name": subject.name, "model": str(subject.model.resolve())}
    return table if subject.stature_m is None else {**table, "stature_m": subject.stature_m}


def execute(run: Run, output: Path | None = None, resume: bool = False, observer: Observer | None = None) -> RunResult:
    """Tracks a sequence and writes its results while it runs.

    Args:
        run: what to do.
        output: result folder; None for `results/<name>/<time>`, with the link `latest`.
        resume: continue an interrupted run in `output`, or in the latest folder, to the same result.
        observer: told of the progress.

    Raises:
        TrackerError: what was computed before it stays in the result folder.
    """
    observer = observer or SilentObserver()
    folder = _result_folder(run.name, output, resume)
    done = read_journal(folder) if resume else []
    sequence = run.reading.open()
    persons = tuple(Person(subject.name, body, body.rest()) for subject, body in ((s, s.body()) for s in run.persons))
    scene = Scene(persons, sequence.rig)
    folder.mkdir(parents=True, exist_ok=True)
    if output is None:
        link_latest(folder)
    cycle = cycle_of(run, sequence.backgrounds, observer.told)
    context = RunContext(
        name=run.name,
        folder=folder,
        scene=scene,
        fps=sequence.fps,
        interval_s=sequence.interval_s,
        n_frames=sequence.n_frames,
        details={"config": run.described(), "versions": _versions(), "inputs": _input_hashes(run, sequence.rig.names)},
        resumed=frozenset(replay.index for replay in done),
    )
    observer.started(run, sequence.n_frames, folder)
    with _log_file(folder):
        if choice := getattr(run.synthesis, "choice", ""):
            log.info("synthesis: %s", choice)
            observer.told(f"synthesis: {choice}")
        return _record(run, context, track(sequence.frames(), scene, cycle, done, sequence.frames), observer)


def cycle_of(
    run: Run, backgrounds: tuple[Image | None, ...], progress: Callable[[str], None] = lambda message: None
) -> Cycle:
    """The tracking cycle of a run's components.

    Args:
        run: the components.
        backgrounds: the clean plates of the views.
        progress: told of what takes long.
    """
    parts = {stage: getattr(run, stage) for stage in _DEFAULTS}
    return Cycle(**parts, loss=run.loss, backgrounds=backgrounds, progress=progress)


def _record(run: Run, context: RunContext, steps: Any, observer: Observer) -> RunResult:
    """Feeds every recorder; they are finished whatever happens."""
    begin, n_frames, n_lost, interrupted = time.perf_counter(), 0, 0, False
    files: list[Path] = []
    with contextlib.ExitStack() as finishing:
        recorders: list[Recorder] = []
        for recording in run.recordings:
            recorders.append(recording.begin(context))
            finishing.callback(_finish, recorders[-1], files)
        finishing.callback(observer.told, "writing the results")
        try:
            for step in steps:
                for recorder in recorders:
                    recorder.write(step)
                n_frames += 1
                n_lost += any(estimate.lost for estimate in step.estimates)
                _log_step(step)
                observer.stepped(step)
        except KeyboardInterrupt:
            interrupted = True
            log.warning("interrupted after %d frames", n_frames)
        except TrackerError as error:
            log.error("%s", error)
            raise
    return RunResult(context.folder, n_frames, n_lost, time.perf_counter() - begin, interrupted, tuple(files))


def _finish(recorder: Recorder, files: list[Path]) -> None:
    """Closes a recorder and puts its files before those of the recorders finished before it: the last ends first."""
    files[:0] = recorder.finish()


def _log_step(step: Step) -> None:
    for person, estimate in zip(step.scene.persons, step.estimates, strict=True):
        log.info(
            "frame %d %s %s %.2f px, %.0f %% explained, %.0f ms",
            step.frame.index,
            person.name,
            estimate.status,
            estimate.distance_px,
            100 * estimate.account.explained,
            1000 * sum(step.seconds.values()),
        )
    if step.start is not None:
        for person, sure in zip(step.scene.persons, step.start.confidence, strict=False):
            log.info("frame %d %s start pose of confidence %.2f", step.frame.index, person.name, sure)
    if step.frame.missing:
        log.warning("frame %d: views %s are missing", step.frame.index, step.frame.missing)


def _result_folder(name: str, output: Path | None, resume: bool) -> Path:
    if output is None and not resume:
        return dated_folder(name)
    output = output or Path("results") / name / "latest"
    if resume:
        if not output.is_dir():
            raise SequenceError(f"{output}: no run to resume there; run without --resume")
        return output.resolve()
    if output.exists() and any(output.iterdir()):
        raise ConfigError(f"{output} is not empty: choose another --output, or continue it with --resume")
    return output


def dated_folder(name: str) -> Path:
    """`results/NAME/TIME`."""
    return Path("results") / name / time.strftime("%Y-%m-%d_%H-%M-%S")


def link_latest(folder: Path) -> None:
    """Points the link `latest` beside a folder at it."""
    link = folder.parent / "latest"
    if folder == link.resolve():
        return
    with contextlib.suppress(OSError):  # a file system without links has no `latest`
        link.unlink(missing_ok=True)
        link.symlink_to(folder.name)


@contextlib.contextmanager
def _log_file(folder: Path) -> Any:
    handler = logging.FileHandler(folder / "log.txt", encoding="utf-8")
    handler.setFormatter(logging.Formatter("%(asctime)s %(levelname)s %(message)s"))
    log.addHandler(handler)
    log.setLevel(logging.INFO)
    try:
        yield
    finally:
        log.removeHandler(handler)
        handler.close()


def _versions() -> dict[str, str]:
    versions = {"python": platform.python_version(), "platform": platform.platform()}
    for package in ("bodytrack", "numpy", "scipy", "numba", "opencv-python-headless", "av"):
        with contextlib.suppress(PackageNotFoundError):
            versions[package] = version(package)
    return versions


def _input_hashes(run: Run, views: tuple[str, ...]) -> dict[str, str]:
    """SHA-256 of every input file."""
    patterns = [getattr(run.reading, name, None) for name in ("rig", "path", "background")]
    files = [subject.model for subject in run.persons]
    for pattern in patterns:
        files += [Path(str(pattern).replace("{view}", view)) for view in views] if pattern else []
    files = [inner for file in files for inner in (sorted(file.iterdir()) if file.is_dir() else [file])]
    unique = dict.fromkeys(file for file in files if file.is_file())
    return {str(file): _sha256(file) for file in unique}


def _sha256(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def with_frames(run: Run, start: int | None, stop: int | None) -> Run:
    """The run over another range of frames; None leaves an end as it is.

    Raises:
        ConfigError: the reading has no such range.
    """
    changes = {key: value for key, value in (("start", start), ("stop", stop)) if value is not None}
    try:
        return replace(run, reading=replace(run.reading, **changes))  # type: ignore[type-var]
    except TypeError as error:
        raise ConfigError(f"--frames: this reading has no start and stop ({error})") from error
