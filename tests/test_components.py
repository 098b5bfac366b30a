"""Every component found in every stage as a piece of configuration: a new file is tested without a word in here."""

from __future__ import annotations

import contextvars
import dataclasses
import datetime
import importlib
import inspect
import pickle
import sys
import tomllib
import typing
from pathlib import Path
from typing import Any

import pytest
import tomli_w
from sections import made, minimal

import tracker.evidence.similarity
from tracker.foundation.configuration.components import ask_before_plugins, available, contract, find, stages
from tracker.foundation.configuration.tables import build, component_stage, describe
from tracker.foundation.errors import ConfigError

UNITS = ("px", "degrees", "metres", "seconds", "grey levels", "share", "frames", "per second", "factor", "rate")
UNITS += ("cosine", "observations", "standard deviations")


def kind_of(stage: str, use: str, name: str) -> Any:
    return typing.get_type_hints(find(stage, use))[name]


STAGES = stages()
COMPONENTS = [(stage, use) for stage in STAGES for use in available(stage)]
FIELDS = [(stage, use, field.name) for stage, use in COMPONENTS for field in dataclasses.fields(find(stage, use))]
every_component = pytest.mark.parametrize(("stage", "use"), COMPONENTS)
every_field = pytest.mark.parametrize(("stage", "use", "name"), FIELDS)
every_plain_field = pytest.mark.parametrize(
    ("stage", "use", "name"), [field for field in FIELDS if kind_of(*field) in (bool, int, float)]
)
every_nested_field = pytest.mark.parametrize(
    ("stage", "use", "name"),
    [field for field in FIELDS if component_stage(kind_of(*field)) and not dataclasses.is_dataclass(kind_of(*field))],
)


def test_all_stages_of_the_cycle_are_found():
    cycle = {"reading", "initialization", "prediction", "synthesis", "evidence", "analysis", "similarity", "estimation"}
    assert set(STAGES) >= cycle | {"recording"}
    assert {stage for stage, _ in COMPONENTS} == set(STAGES)


# What a component is


@every_component
def test_a_component_follows_its_contract_to_the_letter(stage, use):
    cls = find(stage, use)
    assert isinstance(made(stage, use), contract(stage))
    for name, method in inspect.getmembers(contract(stage), inspect.isfunction):
        if name.startswith("_"):
            continue
        wanted, found = inspect.signature(method).parameters, inspect.signature(getattr(cls, name)).parameters
        shape = [(p.name, p.kind, p.default) for p in wanted.values()]
        assert [(p.name, p.kind, p.default) for p in found.values()] == shape


@every_component
def test_a_component_is_a_value(stage, use):
    component = made(stage, use)
    assert component == made(stage, use)
    assert pickle.loads(pickle.dumps(component)) == component
    for field in dataclasses.fields(component):
        with pytest.raises(dataclasses.FrozenInstanceError):
            setattr(component, field.name, getattr(component, field.name))


@every_component
def test_a_component_says_what_it_is(stage, use):
    doc = find(stage, use).__doc__ or ""
    assert doc.strip()
    assert not doc.startswith(find(stage, use).__name__ + "(")  # the signature that dataclasses put there


@every_field
def test_a_field_is_documented_with_its_unit_and_bounded(stage, use, name):
    field = find(stage, use).__pydantic_fields__[name]
    assert field.description
    if kind_of(stage, use, name) is float:
        assert any(unit in field.description.lower() for unit in UNITS), field.description
    if kind_of(stage, use, name) in (int, float):
        assert field.metadata, "any number is taken; expected a bound"


# From the configuration and back


@every_component
def test_the_described_configuration_loads_again_as_an_equal_component(stage, use):
    component = made(stage, use)
    table = tomllib.loads(tomli_w.dumps(describe(component)))
    assert table["use"] == use
    assert build(stage, table, "saved.toml", Path("/elsewhere")) == component


@every_plain_field
def test_a_changed_field_reaches_the_component_and_its_description(stage, use, name):
    kind, usual = kind_of(stage, use, name), getattr(made(stage, use), name)
    changed = not usual if kind is bool else kind(usual + 1 if kind is int else usual * 0.77 + 0.013)
    component = made(stage, use, **{name: changed})
    assert getattr(component, name) == changed
    assert describe(component)[name] == changed
    assert component != made(stage, use)


@every_field
def test_a_misspelt_key_is_answered_with_the_right_one(stage, use, name):
    with pytest.raises(ConfigError) as caught:
        made(stage, use, **{f"{name}x": 1})
    message = str(caught.value)
    assert message.startswith(f'test.toml [{stage}]: unknown key "{name}x"')
    assert name in message
    assert "\n" not in message


@every_component
def test_a_key_that_means_nothing_is_refused(stage, use):
    with pytest.raises(ConfigError, match=r'unknown key "nonsense"; (.*valid: |none is there)'):
        made(stage, use, nonsense=1)


@every_field
def test_a_value_of_no_fitting_type_is_refused_by_name(stage, use, name):
    with pytest.raises(ConfigError) as caught:
        made(stage, use, **{name: datetime.date(1996, 6, 18)})
    assert name in str(caught.value)
    assert "\n" not in str(caught.value)


@every_nested_field
def test_a_nested_component_must_be_one_of_its_stage(stage, use, name):
    inner = component_stage(kind_of(stage, use, name)) or ""
    for other in available(inner):
        if other != use and len(minimal(inner, other)) == 1:
            assert describe(made(stage, use, **{name: {"use": other}}))[name]["use"] == other
    with pytest.raises(ConfigError, match=rf"{name}.*no such component; .*valid: "):
        made(stage, use, **{name: {"use": "nobody"}})


NEW = '''
from __future__ import annotations
import pydantic
from tracker.foundation.configuration.components import component

@component
class {name}:
    """A new way."""
    step_px: float = pydantic.Field(default=2.0, gt=0)
    """Step, px."""
'''


def test_a_new_file_is_a_new_component(tmp_path, monkeypatch):
    (tmp_path / "novelty.py").write_text(NEW.format(name="Novelty"))
    monkeypatch.setattr(tracker.evidence.similarity, "__path__", [*tracker.evidence.similarity.__path__, str(tmp_path)])
    importlib.invalidate_caches()
    assert "novelty" in available("similarity")
    component = build("similarity", {"use": "novelty", "step_px": 3.0}, "here", tmp_path)
    assert describe(component) == {"use": "novelty", "step_px": 3.0}


def test_a_component_of_another_package_is_named_by_module_and_class(tmp_path, monkeypatch):
    (tmp_path / "my_lab_measures.py").write_text(NEW.format(name="Mine") + METHODS)
    monkeypatch.syspath_prepend(tmp_path)
    table = {"use": "my_lab_measures:Mine", "step_px": 3.0}
    component = build("similarity", table, "here", tmp_path)
    assert describe(component) == table
    assert build("similarity", describe(component), "again", tmp_path) == component


METHODS = """
    def distances(self, asked, poses): ...
    def equations(self, asked, q, gate_px=9.0): ...
"""


@pytest.mark.parametrize(
    ("methods", "words"),
    [
        ("", 'no method "distances"'),
        ("    def distances(self, asked, poses): ...", 'no method "equations"'),
        ("    distances = equations = 3", 'no method "distances"'),
        (METHODS.replace("asked, poses", "asked"), r'the method "distances" takes \(self, asked\), expected'),
        ("    raise OSError('no')", "OSError: no; expected an importable"),
    ],
)
def test_a_component_that_does_not_fit_its_stage_is_refused(methods, words, tmp_path, monkeypatch):
    name = f"my_lab_{abs(hash(words))}"
    (tmp_path / f"{name}.py").write_text(NEW.format(name="Mine") + methods)
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(ConfigError, match=words):
        build("similarity", {"use": f"{name}:Mine"}, "here", tmp_path)


def test_who_is_asked_hears_of_code_from_outside_before_it_runs_and_may_forbid_it(tmp_path, monkeypatch):
    (tmp_path / "my_lab_spy.py").write_text("raise AssertionError('it ran')")
    monkeypatch.syspath_prepend(tmp_path)

    def ask(use):
        raise ConfigError(f"{use} is forbidden")

    def asked():
        ask_before_plugins(ask)
        build("similarity", {"use": "my_lab_spy:Mine"}, "here", tmp_path)

    with pytest.raises(ConfigError, match="my_lab_spy:Mine is forbidden"):
        contextvars.copy_context().run(asked)


@pytest.mark.parametrize(
    "use", [":", "a:", ":B", "a b:C", "..a:B", "a/b:C", "a:B:C", "a:__class__.x y", "\0:B", 300 * "a" + ":B"]
)
def test_a_name_that_no_class_can_have_is_not_imported(use):
    with pytest.raises(ConfigError, match="expected an importable"):
        build("similarity", {"use": use}, "here", Path())


@pytest.mark.parametrize("use", ["no_lab:Mine", "json:Nothing", "json:JSONDecoder", "chamfr", "__init__", "../rig"])
def test_what_is_no_component_is_refused_in_one_line(use):
    with pytest.raises(ConfigError) as caught:
        build("similarity", {"use": use}, "here", Path())
    assert f'use = "{use}"' in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_component_whose_package_is_missing_says_what_to_install(monkeypatch):
    monkeypatch.delitem(sys.modules, "tracker.running.batching.dask", raising=False)
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(ConfigError, match='"dask" needs the Python package distributed: pip install distributed'):
        find("batching", "dask")
