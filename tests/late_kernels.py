"""A script: prints what is compiled by tracking, matching and calibrating after the kernels were warmed up."""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import cv2
import numpy as np
from bars import calibration, images_of, recorded
from numba.core.dispatcher import Dispatcher
from textures import Waves, plane_seen

from tracker.camera import Camera
from tracker.frame import Frame
from tracker.jobs import execute, load_job
from tracker.kernels.ahead import GROUPS, warm_up
from tracker.lsm.growth import Growth
from tracker.lsm.surface import SurfaceMeasurement, measure_surface
from tracker.rig import Rig
from tracker.simulation.sequence import Recipe
from tracker.simulation.sequence_files import write_sequence


def signatures() -> set[tuple[str, str]]:
    """What is compiled by now: kernels with the types of their arguments."""
    modules = [module for name, module in list(sys.modules.items()) if name.startswith("tracker.kernels.")]
    kernels = {kernel for module in modules for kernel in vars(module).values() if isinstance(kernel, Dispatcher)}
    return {(f"{kernel.__module__}.{kernel.__name__}", str(types)) for kernel in kernels for types in kernel.signatures}


def track(folder: Path) -> None:
    """A few frames, bootstrapped by plates, the body fitted; then by the other kind of evidence from a given start."""
    config = write_sequence(Recipe("arm_swing", seconds=0.12, size=(240, 192)), folder / "sequence")
    # Plots and the report, which take a third of the time, run no kernels of their own.
    some = "recordings=[{use='csv_table'},{use='overlay'}]", "reading.downscale=1"
    given = "initialization.use=given", "initialization.poses=truth_poses.csv", "persons.0.shape=model", "passes=1"
    for evidence, changes in {"auto": (), "regions": given}.items():
        result = execute(load_job("track", config, [f"evidence.use={evidence}", *some, *changes]), folder / evidence)
        assert result.n_frames == 3


def match() -> None:
    """A textured plane before two cameras."""
    rig = Rig(tuple(Camera.looking_at(n, (240, 180), 520.0, (x, -0.25, 0.7), np.zeros(3)) for n, x in _EYES.items()))
    texture = Waves(0.012, widest=16.0, n=120)
    seen = [plane_seen(texture, camera, 1.0, k) for k, camera in enumerate(rig.cameras)]
    frame = Frame(0, 0.0, tuple(cv2.cvtColor(image, cv2.COLOR_GRAY2BGR) for image in seen))
    surface = measure_surface(SurfaceMeasurement(growth=Growth(step_px=8)), frame, rig)
    assert len(surface.points) > 100


_EYES = {"left": -0.12, "middle": 0.0, "right": 0.12}


def calibrate() -> None:
    """Cameras from a bar."""
    calibration().calibrate_images(images_of(recorded()))


if __name__ == "__main__":
    for group in GROUPS:
        warm_up(group=group)
    ahead = signatures()
    with tempfile.TemporaryDirectory() as folder:
        track(Path(folder))
    match()
    calibrate()
    sys.stdout.writelines(f"{kernel} {types}\n" for kernel, types in sorted(signatures() - ahead))
