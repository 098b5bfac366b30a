"""The extension's border: arrays that a kernel cannot take are refused by name, and old builds are never run."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

import tracker._native as native
from tracker.foundation.errors import InstallationError
from tracker.foundation.native_sources import digest_of, load_extension

ROOT = Path(__file__).parents[1]


def asked(**changes):
    """Arguments of a kernel of which one is changed."""
    good = {
        "queried": np.ones((4, 2, 3), np.float32),
        "known": np.ones((5, 2, 3), np.float32),
        "weights": np.full(2, 0.5, np.float32),
        "gaps": np.full((4, 5), np.nan, np.float32),
    }
    return {**good, **changes}


def read_only():
    array = np.zeros((4, 5), np.float32)
    array.setflags(write=False)
    return array


def test_good_arguments_are_taken_also_read_only_and_empty_ones():
    queried = np.ones((4, 2, 3), np.float32)
    queried.setflags(write=False)
    arguments = asked(queried=queried)
    native.direction_gaps(**arguments)
    np.testing.assert_allclose(arguments["gaps"], 0)
    native.direction_gaps(**asked(queried=np.ones((0, 2, 3), np.float32), gaps=np.zeros((0, 5), np.float32)))


def test_arrays_whose_rows_lie_apart_are_taken_and_written():
    rng = np.random.default_rng(0)
    apart, told = rng.normal(size=(5, 2, 6)).astype(np.float32)[..., ::2], np.full((8, 10), -1, np.float32)
    plain = asked(known=np.ascontiguousarray(apart))
    native.direction_gaps(**asked(known=apart, gaps=told[::2, ::2]))
    native.direction_gaps(**plain)
    np.testing.assert_array_equal(told[::2, ::2], plain["gaps"])
    assert (told[1::2] == -1).all()
    assert (told[:, 1::2] == -1).all()


@pytest.mark.parametrize(
    ("changes", "kind", "told"),
    [
        ({"queried": np.ones((4, 2, 3))}, TypeError, "queried: expected an array of float32 .*found float64"),
        ({"queried": [1.0, 2.0]}, TypeError, "queried: .*found list"),
        ({"queried": None}, TypeError, "queried: .*found NoneType"),
        ({"queried": np.ones((4, 2, 3), ">f4")}, TypeError, "queried: .*found >f4"),
        ({"queried": np.ones((4, 2, 2), np.float32)}, ValueError, r"queried: .*\(any, any, 3\), found \(4, 2, 2\)"),
        ({"queried": np.ones((4, 6), np.float32)}, ValueError, r"queried: .*found \(4, 6\)"),
        ({"known": np.ones((5, 3, 3), np.float32)}, ValueError, r"known: .*\(any, 2, 3\), found \(5, 3, 3\)"),
        ({"weights": np.ones(3, np.float32)}, ValueError, r"weights: .*\(2,?\), found \(3,?\)"),
        ({"gaps": np.ones((4, 4), np.float32)}, ValueError, r"gaps: .*\(4, 5\), found \(4, 4\)"),
        ({"gaps": read_only()}, ValueError, "gaps: expected a writable .*found it read-only"),
    ],
)
def test_what_a_kernel_cannot_take_is_refused_by_name(changes, kind, told):
    with pytest.raises(kind, match=f"^{told}"):
        native.direction_gaps(**asked(**changes))


@pytest.mark.parametrize("first", [[0, 3, 2, 4], [1, 2, 3, 4], [0, 1, 2, 5]])
def test_places_in_another_array_are_checked(first):
    rules = np.zeros(3, np.bool_), np.zeros(3, np.int64)
    with pytest.raises(ValueError, match=r"^first: expected places that rise from 0 to 4$"):
        native.warp_sequence(
            np.ones((2, 4), np.float32), np.array(first, np.int64), *rules, 1.0, 1.0, np.zeros((3, 3), np.int64)
        )


def test_a_build_of_other_sources_is_refused(tmp_path):
    shutil.copytree(ROOT / "native", tmp_path / "native")
    load_extension(tmp_path)
    (tmp_path / "native" / "array.hpp").write_text("// changed")
    assert digest_of(tmp_path / "native") != native.SOURCES
    with pytest.raises(InstallationError, match=r"built from other sources .*scripts/build_native\.sh"):
        load_extension(tmp_path)


def test_an_extension_that_is_missing_says_how_to_build_it(tmp_path, monkeypatch):
    monkeypatch.setattr("tracker.foundation.native_sources._EXTENSION", "tracker._absent")
    with pytest.raises(InstallationError, match=r"No module named 'tracker\._absent'; .*scripts/build_native\.sh"):
        load_extension(tmp_path)
