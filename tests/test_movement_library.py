"""Libraries of movements on disk: added to, put together, damaged."""

from __future__ import annotations

import importlib
from pathlib import Path

import numpy as np
import pytest
import typer
from known_movements import LIBRARY, known

from tracker.foundation.errors import ConfigError
from tracker.foundation.resources import model_path
from tracker.results.recognition import Course
from tracker.results.recognition.library import Description, add_performance, load_library


def test_a_library_on_disk_is_what_was_added(tmp_path):
    asked = Course(0.0, known("kick"), np.ones(len(known("kick")), bool))
    told = Description(about='a "quick" kick', source="ours")
    path, _ = add_performance(tmp_path / "mine", "kick", "anna", asked, told)
    movement = load_library((tmp_path / "mine",)).movements["kick"]
    assert movement.description == told
    np.testing.assert_allclose(movement.performances["anna"], asked.directions, atol=2e-3)
    both = load_library((tmp_path / "mine", model_path("human").parent / "movements"))
    assert set(both.movements) == set(LIBRARY.movements)
    assert len(both.movements["kick"].performances) == 2
    with pytest.raises(ConfigError, match=f"{path} is there already"):
        add_performance(tmp_path / "mine", "kick", "anna", asked, told)
    with pytest.raises(ConfigError, match="--no-repeats"):
        add_performance(tmp_path / "mine", "kick", "ben", asked, Description(repeats=True))
    with pytest.raises(ConfigError, match="in the name"):
        add_performance(tmp_path / "mine", "../kick", "ben", asked, told)
    for n_frames, repeats, length in ((5, False, "0.20"), (1, True, "0.04")):
        with pytest.raises(ConfigError, match=f"{length} s, expected 0.32 to 60 s"):
            add_performance(tmp_path / "mine", "nod", "ben", asked.part(0, n_frames), Description(repeats=repeats))
    assert sorted(file.name for file in tmp_path.rglob("*") if file.is_file()) == ["anna.csv", "movement.toml"]


def test_performances_of_one_name_in_several_libraries_add_up(tmp_path):
    mine, theirs = tmp_path / "mine", tmp_path / "theirs"
    for folder, name in ((mine, "kick"), (theirs, "punch")):
        asked = Course(0.0, known(name), np.ones(len(known(name)), bool))
        add_performance(folder, "fight", "anna", asked, Description())
    lengths = [len(one) for one in load_library((mine, theirs)).movements["fight"].performances.values()]
    assert lengths == [len(known("kick")), len(known("punch"))]
    assert len(load_library((mine, mine / ".." / "mine")).movements["fight"].performances) == 1


@pytest.mark.parametrize(
    ("change", "fault"),
    [
        (lambda text: text.replace("left_thigh_x", "left_thig_x"), 'did you mean "left_thigh_x"'),
        (lambda text: text.replace("0.04,", "0.05,", 1), "the times are not 0.04 s apart"),
        (lambda text: "\n".join(text.splitlines()[:4]), "3 rows, expected 8 to 1500"),
        (lambda text: text.replace("0.00,", "0.00,7", 1), "has length"),
        (lambda text: text.replace("0.00,", "0.00,x", 1), "expected a finite number"),
        (lambda text: text.replace("\n", ",1\n", 3), "cells in row|called"),
        (lambda text: "", "empty"),
    ],
)
def test_a_damaged_performance_is_named(tmp_path, change, fault):
    asked = Course(0.0, known("kick"), np.ones(len(known("kick")), bool))
    path, _ = add_performance(tmp_path, "kick", "anna", asked, Description())
    path.write_text(change(path.read_text()))
    with pytest.raises(ConfigError, match=fault) as error:
        load_library((tmp_path,))
    assert str(path) in str(error.value)


def test_a_damaged_library_is_named(tmp_path):
    with pytest.raises(ConfigError, match="no such folder"):
        load_library((tmp_path / "none",))
    with pytest.raises(ConfigError, match="no movement in it"):
        load_library((tmp_path,))
    (tmp_path / "kick").mkdir()
    (tmp_path / "kick" / "movement.toml").write_text("repeat = true")
    (tmp_path / "kick" / "a.csv").write_text("")
    with pytest.raises(ConfigError, match='unknown key "repeat"; did you mean "repeats"'):
        load_library((tmp_path,))
    (tmp_path / "kick" / "movement.toml").write_text("repeats = 3")
    with pytest.raises(ConfigError, match=r"movement\.toml: repeats"):
        load_library((tmp_path,))


def test_the_bundled_library_stays_where_a_new_one_cannot_be_made(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(Path(__file__).parents[1] / "scripts")
    monkeypatch.setenv("BODYTRACK_DATA", str(tmp_path))
    script = importlib.import_module("make_movements")
    library = tmp_path / "library"
    add_performance(
        library, "kick", "anna", Course(0.0, known("kick"), np.ones(len(known("kick")), bool)), Description()
    )
    with pytest.raises(typer.Exit):
        script.main(library)
    (tmp_path / "motions" / "deepmimic").mkdir(parents=True)  # without clips
    with pytest.raises(FileNotFoundError):
        script.main(library)
    assert list(load_library((library,)).movements) == ["kick"]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["library", "motions"]
