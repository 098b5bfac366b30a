"""`bodytrack show frame RESULT --frame N`: what each kind of evidence saw in a frame, as pictures."""

from __future__ import annotations

from pathlib import Path

from tracker.foundation.errors import ConfigError
from tracker.running.commands.terminal import console


def show_frame(
    result: Path, frame: int, chosen: tuple[str | None, str | None], output: Path | None, overwrite: bool
) -> None:
    """Writes a PNG a view into the result's exports.

    Args:
        result: folder of a run.
        frame: its number.
        chosen: view and person; None for all views, and for the first person.
        output: folder to write to instead.
        overwrite: whether files that are there already are replaced.

    Raises:
        TrackerError: there is no such frame, view or person, the recording is gone, or a file is there already.
    """
    from tracker.foundation.errors import nearest
    from tracker.foundation.files import check_free
    from tracker.images.film import write_picture
    from tracker.results.exports import EXPORTS
    from tracker.results.result import load_result
    from tracker.running.viewing.evidence_picture import evidence_picture
    from tracker.running.viewing.frame_evidence import seen_in_frame

    (view, person), loaded = chosen, load_result(result)
    names = loaded.rig.names if view is None else (view,)
    if view is not None and view not in loaded.rig.names:
        raise ConfigError(f'{result}: no view is called "{view}"; {nearest(view, loaded.rig.names)}')
    who, folder = person or next(iter(loaded.bodies)), output or result / EXPORTS
    paths = {name: folder / f"frame_{frame:06d}_{who}_{name}.png" for name in names}
    check_free(paths.values(), overwrite)
    seen = seen_in_frame(loaded, frame, who)
    folder.mkdir(parents=True, exist_ok=True)
    for one in seen.views:
        if one.name in paths:
            write_picture(paths[one.name], evidence_picture(seen, one, _CELL_PX))
            left_out = "; ".join(made.title for made in one.pictures if made.picture is None)
            told = f"written: {paths[one.name]}" + (f"; left out: {left_out}" if left_out else "")
            console.print(told, highlight=False, soft_wrap=True)
    for name in names:
        if name not in {one.name for one in seen.views}:
            console.print(f"{name}: has no image in frame {frame}", highlight=False)
    if seen.differs:
        console.print(seen.differs, style="yellow", highlight=False, soft_wrap=True)


_CELL_PX = 480
"""Width of each of the pictures that are put together."""
