"""`bodytrack view`: a run in space, in a browser on this machine."""

from __future__ import annotations

import contextlib
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from tracker.running.commands import Overrides, Overwrite, ProgressBar, console

if TYPE_CHECKING:
    from tracker.results.result import Result


def view(
    what: Annotated[Path, typer.Argument(help="Result folder; or a configuration, to watch while it tracks.")],
    set_: Overrides = None,
    port: Annotated[int, typer.Option(min=1, max=65535, help="Port; the next free one if it is taken.")] = 8080,
    place: Annotated[
        int | None, typer.Option(min=0, help="Number of a frame: place the bodies in it by hand, and save a start.")
    ] = None,
    output: Annotated[
        Path | None, typer.Option(help="With --place: the start's file; default start.csv beside WHAT, or in exports.")
    ] = None,
    overwrite: Overwrite = False,
) -> None:
    """Shows a result, or a run while it tracks, in a browser on this machine; needs viser. Ctrl-C ends it.

    With --place it shows one frame, and you pose the bodies in it: initialization `given` begins from the poses that
    you save.
    """
    from tracker.foundation.errors import ConfigError
    from tracker.results.result import load_result
    from tracker.running.viewing.stage import serving

    live = what.suffix.lower() == ".toml" and not what.is_dir()
    if set_ and not live:
        raise ConfigError(f"--set: {what} is a result; it was tracked as its config.toml says")
    if place is not None:
        _placed(what, (set_ or []) if live else None, place, (output, overwrite), port)
        return
    if output is not None or overwrite:
        raise ConfigError(f"--{'output' if output else 'overwrite'}: only --place writes a file")
    result = None if live else load_result(what)
    with serving(port) as server:
        if result is None:
            _live(what, set_ or [], server)
        else:
            _finished(result, server)


def _placed(what: Path, overrides: list[str] | None, number: int, written: tuple[Path | None, bool], port: int) -> None:
    """Poses bodies in a frame of a configuration, or of a result, which takes no overrides."""
    from tracker.foundation.files import check_free
    from tracker.results.exports import EXPORTS
    from tracker.running.viewing.hand_poses import Placing, begun_in_result, begun_in_run
    from tracker.running.viewing.stage import serving

    folder = what.parent if overrides is not None else what / EXPORTS
    path = written[0] or folder / "start.csv"
    check_free([path], written[1])
    scene, frame = begun_in_result(what, number) if overrides is None else begun_in_run(what, overrides, number)
    path.parent.mkdir(parents=True, exist_ok=True)
    with serving(port, wide=True) as server:
        placing = Placing(server, scene, frame, path)
        with contextlib.suppress(KeyboardInterrupt):
            _tell_address(server)
            placing.serve()
    given = f'initialization = {{ use = "given", poses = "{path.resolve()}" }}'
    told = f"written: {path}; begin from it: {given} in the configuration, and --frames {number}:"
    console.print(told if placing.saved else "no start was saved", highlight=False, soft_wrap=True)


def _finished(result: Result, server: Any) -> None:
    from tracker.running.viewing.viewer import view_result

    viewer, fault = view_result(result, server)
    if fault:
        console.print(f"without images: {fault}", style="yellow", highlight=False, soft_wrap=True)
    with contextlib.suppress(KeyboardInterrupt):
        _tell_address(server)
        viewer.serve()
    viewer.pictures.stop()


def _live(config: Path, overrides: list[str], server: Any) -> None:
    from tracker.images.reading.live import counts_of
    from tracker.running.programs import load_run
    from tracker.running.viewing.viewer import LiveRun

    run = load_run(config, ["passes=1", *overrides])  # every frame at once
    with ProgressBar() as progress:
        live = LiveRun(run, server, progress)
        with contextlib.suppress(KeyboardInterrupt):
            _tell_address(server)
            console.print(
                "this only shows the tracking, and writes nothing; `bodytrack run` writes results", highlight=False
            )
            while not live.done.is_set():
                live.viewer.serve(0.5)
            if live.fault is None:
                console.print("all frames are tracked", highlight=False)
                if (counts := counts_of(run.opened.sequence)) is not None:
                    console.print(counts.told(), highlight=False, soft_wrap=True)
                live.viewer.serve()
        live.close()
    if live.fault is not None:
        raise live.fault


def _tell_address(server: Any) -> None:
    console.print(f"look at http://127.0.0.1:{server.get_port()}; Ctrl-C ends it", highlight=False)
