"""Marker files in the forms that programs write them: TRC as text, C3D as bytes of any processor."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from tracker.results.markers import Markers

KEYS = ("DataRate", "CameraRate", "NumFrames", "NumMarkers", "Units", "OrigDataRate", "OrigDataStartFrame")
NAMES = ("LSHO", "LELB", "LWRI")
POINTS_MM = np.round(np.random.default_rng(0).uniform(-900, 1900, (20, 3, 3)), 1)
"""(T, M, 3)."""

Value = float | Sequence[int] | Sequence[float] | Sequence[str]


def trc(
    cells: Sequence[Sequence[str]] | None = None,
    *,
    names: Sequence[str] = NAMES,
    values: str = "100.00\t100.00\t20\t3\tmm\t100.00\t1",
    path: str = "a.trc",
) -> str:
    """A table of twenty frames at 100 Hz."""
    lines = [
        f"PathFileType\t4\t(X/Y/Z)\t{path}",
        "\t".join(KEYS),
        values,
        "Frame#\tTime\t" + "\t\t\t".join(names) + "\t\t",
        "\t\t" + "\t".join(f"{axis}{k + 1}" for k in range(len(names)) for axis in "XYZ"),
        "",
    ]
    told = cells or [[f"{value:.1f}" for value in row.ravel()] for row in POINTS_MM]
    lines += [f"{k + 1}\t{k / 100:.3f}\t" + "\t".join(row) for k, row in enumerate(told)]
    return "\n".join(lines) + "\n"


class C3d:
    """Writes one: parameters of any name, points and analog signals of each frame, rotations behind them."""

    def __init__(self, processor: int = 84) -> None:
        self.processor = processor

    def whole(self, numbers: object, kind: str = "i2") -> bytes:
        return np.asarray(numbers).astype(f"{'>' if self.processor == 86 else '<'}{kind}").tobytes()

    def floats(self, numbers: object) -> bytes:
        if self.processor != 85:
            return self.whole(numbers, "f4")
        halves = (4 * np.asarray(numbers, dtype="<f4")).reshape(-1).view("<u2").reshape(-1, 2)[:, ::-1]
        return np.ascontiguousarray(halves).tobytes()

    def _value(self, value: Value) -> bytes:
        if isinstance(value, float):
            return b"\x04\x00" + self.floats([value])
        if not isinstance(value, Sequence):
            return b"\x02\x00" + self.whole([value], "u2")
        if len(value) and isinstance(value[0], str):
            texts = [str(text).encode("latin-1") for text in value]
            width = max(map(len, texts))
            return bytes([255, 2, width, len(texts)]) + b"".join(text.ljust(width) for text in texts)
        if len(value) and isinstance(value[0], float):
            return bytes([4, 1, len(value)]) + self.floats(value)
        return bytes([2, 1, len(value)]) + self.whole(value, "u2")

    def _parameters(self, parameters: Mapping[str, Value]) -> bytes:
        groups = list(dict.fromkeys(name.partition(":")[0] for name in parameters))
        found = b""
        for k, group in enumerate(groups, start=1):
            found += bytes([len(group), 256 - k]) + group.encode() + self.whole([3]) + b"\0"
        for name, value in parameters.items():
            group, _, own = name.partition(":")
            content = self._value(value) + b"\0"
            found += (
                bytes([len(own), groups.index(group) + 1]) + own.encode() + self.whole([2 + len(content)]) + content
            )
        found += b"\0\0"
        return found

    def written(
        self,
        parameters: Mapping[str, Value],
        frames: bytes,
        *,
        header: Mapping[str, float] | None = None,
        rotations: bytes = b"",
    ) -> bytes:
        """All of it; `DATA_START` of both groups is set where the groups are there."""
        told = dict(parameters)
        blocks = math.ceil((4 + len(self._parameters({**told, "ROTATION:DATA_START": 9}))) / 512)
        n_frames = math.ceil(len(frames) / 512)
        if rotations:
            told["ROTATION:DATA_START"] = 2 + blocks + n_frames
        listed = bytes([1, 0x50, blocks, self.processor]) + self._parameters(told)
        head = {"points": 0, "analog": 0, "first": 1, "last": 20, "scale": -1.0, "rate": 100.0, **(header or {})}
        start = bytes([2, 0x50]) + self.whole([head[key] for key in ("points", "analog", "first", "last")], "u2")
        start += (
            self.whole([0]) + self.floats([head["scale"]]) + self.whole([2 + blocks, 0]) + self.floats([head["rate"]])
        )
        parts = (start.ljust(512, b"\0"), listed.ljust(512 * blocks, b"\0"), frames.ljust(512 * n_frames, b"\0"))
        return b"".join(parts) + rotations


def points_bytes(
    file: C3d, points: np.ndarray, residuals: np.ndarray | float = 0.0, analog: np.ndarray | None = None
) -> bytes:
    """Frames of points (T, M, 3) and signals (T, K), as numbers with a fraction."""
    fourth = np.broadcast_to(residuals, points.shape[:2])[..., None]
    numbers = np.concatenate([points, fourth], axis=-1).reshape(len(points), -1)
    return file.floats(numbers if analog is None else np.concatenate([numbers, analog], axis=1))


def point_parameters(**changes: Value) -> dict[str, Value]:
    """Of the group POINT for `POINTS_MM`."""
    told: dict[str, Value] = {"USED": 3, "SCALE": -1.0, "RATE": 100.0, "FRAMES": 20, "UNITS": ["mm"], "LABELS": NAMES}
    return {f"POINT:{name}": value for name, value in (told | changes).items()}


def rotation_bytes(file: C3d, origins: np.ndarray, reliability: float = 1.0) -> bytes:
    """Frames of 4x4 matrices column by column, turned in no way, with origins (T, S, 3)."""
    placed = np.zeros((*origins.shape[:2], 17))
    placed[..., [0, 5, 10, 15]], placed[..., 12:15], placed[..., 16] = 1.0, origins, reliability
    return file.floats(placed)


TIMES_S = np.arange(20) / 100


POINTS = POINTS_MM / 1000


def written(folder: Path, content: str | bytes, name: str = "a.trc") -> Path:
    path = folder / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


def same(read: Markers, points: np.ndarray = POINTS, names: tuple[str, ...] = NAMES) -> None:
    assert read.names == names
    np.testing.assert_allclose(read.times_s, TIMES_S[: len(points)], atol=1e-9)
    np.testing.assert_allclose(read.points, points, atol=2e-7)
