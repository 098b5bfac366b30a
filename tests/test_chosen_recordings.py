"""Which recordings a run leaves: the defaults, changed or replaced."""

from __future__ import annotations

import re
import sys
from pathlib import Path
from types import ModuleType

import pytest

from tracker.foundation.configuration.components import component
from tracker.foundation.errors import ConfigError
from tracker.results.recording import DEFAULTS, chosen_recordings
from tracker.results.recording.overlay import Overlay


def uses(entry):
    return tuple(type(r).__module__.rpartition(".")[2] for r in chosen_recordings(entry, "run.toml", Path()))


@pytest.mark.parametrize(
    ("entry", "chosen"),
    [
        ({}, DEFAULTS),
        ({"overlay": False}, tuple(use for use in DEFAULTS if use != "overlay")),
        ({"overlay": True}, DEFAULTS),
        ({"report": {"pictures": 3}}, DEFAULTS),
        ({"my_lab.recordings:Nothing": True}, (*DEFAULTS, "recordings")),
        (["csv_table"], ("csv_table",)),
        (["journal", {"use": "overlay", "width_px": 320}], ("journal", "overlay")),
        ([], ()),
    ],
)
def test_recordings_change_the_defaults_or_replace_them(entry, chosen, monkeypatch):
    laboratory = ModuleType("my_lab.recordings")
    laboratory.Nothing = component(
        type("Nothing", (), {"__module__": "my_lab.recordings", "begin": lambda self, run: None})
    )
    monkeypatch.setitem(sys.modules, "my_lab", ModuleType("my_lab"))
    monkeypatch.setitem(sys.modules, "my_lab.recordings", laboratory)
    assert uses(entry) == chosen


def test_the_settings_of_a_default_recording_are_changed_in_its_place():
    assert chosen_recordings({"overlay": {"width_px": 320}}, "", Path())[2] == Overlay(width_px=320)


@pytest.mark.parametrize(
    ("entry", "words"),
    [
        ({"overlaj": False}, 'no recording "overlaj"; did you mean "overlay"'),
        (["overlaj"], 'use = "overlaj": no such component; did you mean "overlay"'),
        ({"overlay": "no"}, "overlay = 'no', expected true, false or a table"),
        ({"overlay": {"use": "plots"}}, "no `use` expected"),
        ({"overlay": {"width": 320}}, 'unknown key "width"; did you mean "width_px"'),
        ([{"width_px": 320}], "no `use`"),
        ([3], "3 found, expected a name"),
        ("overlay", "'overlay' found, expected a list of names, or a table"),
        (["overlay", {"use": "overlay", "quality": 30}], '"overlay" is named twice'),
    ],
)
def test_a_wrong_choice_of_recordings_is_one_clear_line(entry, words):
    with pytest.raises(ConfigError, match=re.escape(words)) as caught:
        chosen_recordings(entry, "run.toml [recordings]", Path())
    assert str(caught.value).startswith("run.toml [recordings]")
    assert "\n" not in str(caught.value)
