"""What renderers say where a graphics library or package is missing: one line, with what to install."""

from __future__ import annotations

import sys
from types import SimpleNamespace
from typing import Any

import pytest

from tracker.bodies.scene import Scene
from tracker.foundation.errors import RenderError
from tracker.synthesis import _atlas, _graphics
from tracker.synthesis.osmesa import OsmesaSynthesis

MISSING = {
    "not installed": ModuleNotFoundError("No module named 'moderngl'", name="moderngl"),
    "no libGL": Exception("libGL.so not loaded"),
    "obscure": AttributeError("'NoneType' object has no attribute 'glGetError'"),
    "old binding": ImportError("cannot import name 'OSMesaCreateContextAttribs' from 'OpenGL.osmesa'"),
    "two lines": ImportError("Unable to load EGL library\nlibEGL.so.1: cannot open"),
}
ADVICE = {
    "not installed": r'synthesis "egl" needs the Python package moderngl: pip install moderngl',
    "no libGL": r'"egl" finds no OpenGL .*libGL.so not loaded.*: apt-get install -y --no-install-recommends libegl1',
    "obscure": r"AttributeError .*apt-get install -y --no-install-recommends libegl1 libgl1 libxrender1 libosmesa6",
    "old binding": r'pip install -U "PyOpenGL>=3.1.10"',
    "two lines": r"Unable to load EGL library\): apt-get install",
}


@pytest.mark.parametrize("reason", MISSING)
def test_what_is_missing_is_said_in_one_line(reason: str, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(name: str) -> Any:
        raise MISSING[reason]

    monkeypatch.setattr(_graphics.importlib, "import_module", fail)
    with pytest.raises(RenderError, match=ADVICE[reason]) as caught:
        _atlas.Atlas(0)
    assert "\n" not in str(caught.value)


def test_a_failure_while_drawing_is_said_in_one_line(truth: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*size: int) -> Any:
        raise AttributeError("'EGLPlatform' object has no attribute 'OSMesa'\nand more")

    broken = SimpleNamespace(create_context=fail)
    monkeypatch.setattr(_atlas, "library", lambda name, use: broken)
    with pytest.raises(RenderError, match=r"finds no OpenGL it can use .*: apt-get install") as caught:
        _atlas.Atlas(0)
    assert "\n" not in str(caught.value)


def test_without_pyrender_the_reference_says_so(truth: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pyrender", None)
    with pytest.raises(RenderError, match=r'"osmesa" needs the Python package pyrender: pip install pyrender'):
        OsmesaSynthesis().part_ids(truth)
