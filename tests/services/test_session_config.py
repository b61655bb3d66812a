"""The record that describes a session: by JSON, by the command line, by the form."""

import enum
import inspect
import json
import typing
from typing import Annotated, Any

import msgspec
import pytest
import typer
from hypothesis import given
from hypothesis import strategies as st
from msgspec import Meta
from typer.testing import CliRunner

from entoptic.services import config, process_config
from entoptic.services.command_line import option_names, options
from entoptic.services.config import Eyes, EyesConfig, Save, SettingsConfig, ViewConfig
from entoptic.services.console.fields import session_fields
from entoptic.services.records import Leaf, is_record, leaves, nested, options_of
from entoptic.services.session_config import OpenedSession, SessionConfig, open_session
from entoptic.services.settings import Settings, SettingsError, changed, of
from entoptic.tracker_bridge.chain import LatencyMode

RECORDS = [
    kind
    for module in (config, process_config)
    for _, kind in inspect.getmembers(module, is_record)
    if kind.__module__ == module.__name__
]
SAID_BY_THEIR_NAMES = ("observer.iris", "plan.leave_out")
SESSION = leaves(EyesConfig) + leaves(ViewConfig)


def values_of(leaf: Leaf) -> st.SearchStrategy[Any]:
    """Whatever a field takes, as built-in types."""
    if issubclass(leaf.kind, (Eyes, Save, LatencyMode)):
        one: st.SearchStrategy[Any] = st.sampled_from([str(each.value) for each in leaf.kind])
    elif leaf.kind is bool:
        one = st.booleans()
    elif leaf.kind is str:
        one = st.text(st.characters(categories=("L", "N")), min_size=1)
    else:
        low, high = leaf.low if leaf.low is not None else 0, leaf.high if leaf.high is not None else 2**31
        one = st.integers(int(low), int(high)) if leaf.kind is int else st.floats(low, high)
    one = st.lists(one, max_size=3) if leaf.many else one
    return st.none() | one if leaf.optional else one


def some(record: type[msgspec.Struct]) -> st.SearchStrategy[dict[str, Any]]:
    """Any of a record's fields with any values."""
    return st.fixed_dictionaries({}, optional={leaf.path: values_of(leaf) for leaf in leaves(record)})


def by_command_line(arguments: list[str]) -> SessionConfig:
    taken: list[SessionConfig] = []

    @options
    def command(eyes: EyesConfig, view: ViewConfig, settings: SettingsConfig) -> None:
        taken.append(SessionConfig(eyes=eyes, view=view, settings=of(settings)))

    app = typer.Typer()
    app.command()(command)
    result = CliRunner().invoke(app, arguments)
    if result.exit_code:
        raise ValueError(result.output) from result.exception
    return taken[0]


@given(some(EyesConfig), some(ViewConfig))
def test_by_json_by_the_command_line_and_by_the_form_it_is_the_same(eyes: dict[str, Any], view: dict[str, Any]) -> None:
    known = {leaf.path: leaf for leaf in SESSION}
    arguments: list[str] = []
    for path, value in {**eyes, **view}.items():
        every = value if isinstance(value, list) else [] if value is None else [value]
        arguments += [f"{option_names(known[path])[0]}={one}" for one in every]
    # Where nothing is given at all there is the default.
    given_ = {path: value for path, value in {**eyes, **view}.items() if value not in (None, [])}
    made = by_command_line(arguments)
    tables = {
        "eyes": {k: v for k, v in eyes.items() if k in given_},
        "view": {k: v for k, v in view.items() if k in given_},
    }
    assert made == msgspec.convert(tables, SessionConfig)
    # As the page sends it, and as a child and session.json have it.
    by_form = {
        field.path: given_[name] for field in session_fields() if (name := field.path.partition(".")[2]) in given_
    }
    assert msgspec.convert(json.loads(json.dumps(nested(by_form))), SessionConfig) == made
    assert msgspec.json.decode(msgspec.json.encode(made), type=SessionConfig) == made


def test_settings_go_along_and_what_is_unknown_is_refused_with_its_path() -> None:
    made = by_command_line(["--set", "age_years = 61", "--set", "glare.level=eighth", "--budget-ms", "20"])
    assert made.settings == changed(
        Settings(), {"observer.age_years": 61, "glare.level": "eighth", "plan.budget_ms": 20.0}
    )
    assert msgspec.json.decode(msgspec.json.encode(made), type=SessionConfig) == made
    for given_, said in (
        ({"view": {"fovea": 3}}, r"fovea.*\$\.view"),
        ({"settings": {"observer": {"legs": 4}}}, r"legs.*\$\.settings\.observer"),
        ({"view": {"fps": 0}}, r">= 0\.1.*\$\.view\.fps"),
        ({"eyes": {"latency_mode": "slow"}}, r"slow.*\$\.eyes\.latency_mode"),
    ):
        with pytest.raises(msgspec.ValidationError, match=said):
            msgspec.convert(given_, SessionConfig)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ("observer.age_years", "give it like observer.age_years=60"),
        ("observer.age=3", "no setting 'observer.age'; is it observer.age_years"),
        ("observer.age_years=500", r"<= 120.*observer\.age_years"),
        ("observer=3", "no setting 'observer'"),
        ("seed=3", "more than one setting: give one of rod_noise.seed, observer.seed"),
        ("iris=pink", "pink.*it may be dark, brown"),
    ],
)
def test_a_setting_that_cannot_be_is_named(change: str, said: str) -> None:
    with pytest.raises(SettingsError, match=f"--set: .*{said}"):
        of(SettingsConfig(changes=(change,)))


@pytest.mark.parametrize(
    "leaf", [leaf for leaf in SESSION if leaf.low is not None or leaf.high is not None], ids=lambda leaf: leaf.path
)
def test_an_error_of_range_names_the_option(leaf: Leaf) -> None:
    beyond = [end for end in ((leaf.low or 0) - 1, None if leaf.high is None else leaf.high + 1) if end is not None]
    for value in beyond:
        with pytest.raises(ValueError, match=option_names(leaf)[0]):
            by_command_line([f"{option_names(leaf)[0]}={value}"])


@pytest.mark.parametrize("leaf", leaves(Settings), ids=lambda leaf: leaf.path)
def test_every_setting_and_every_choice_says_what_it_means(leaf: Leaf) -> None:
    assert leaf.description.endswith("."), leaf.path
    told = [sentence for value, sentence in (options_of(leaf.kind) if issubclass(leaf.kind, enum.Enum) else ())]
    # None where the words say it themselves, as an iris' colours.
    assert leaf.path in SAID_BY_THEIR_NAMES or all(sentence.endswith(".") for sentence in told)


@pytest.mark.parametrize("record", RECORDS, ids=lambda record: record.__name__)
def test_every_field_says_what_it_is(record: type[msgspec.Struct]) -> None:
    assert record.__doc__
    for leaf in leaves(record):
        assert leaf.description.endswith("."), leaf.path
    assert len({name for leaf in leaves(record) for name in option_names(leaf)}) >= len(leaves(record))


def test_limits_that_are_no_option_s_are_named_too() -> None:
    class Open(msgspec.Struct):
        share: Annotated[float, Meta(gt=0.0, lt=1.0, description="A share.")] = 0.5

    @options
    def command(record: Open) -> None:
        pass

    app = typer.Typer()
    app.command()(command)
    assert CliRunner().invoke(app, ["--share", "0.1"]).exit_code == 0
    refused = CliRunner().invoke(app, ["--share", "0"])
    assert refused.exit_code == 2
    assert "--share" in refused.output


def test_a_session_s_size_is_known_when_it_is_open() -> None:
    opened = open_session(SessionConfig(view=ViewConfig(width_px=90)))
    assert isinstance(opened, OpenedSession)
    assert (opened.config.view.width_px, opened.config.view.height_px) == (90, opened.view.height_px)
    assert open_session(opened.config).config == opened.config


def test_commands_say_their_types_to_whoever_asks() -> None:
    @options
    def command(eyes: EyesConfig, plain: int = 3) -> None:
        pass

    hints = typing.get_type_hints(command, include_extras=True)
    assert set(inspect.signature(command).parameters) == set(hints)
    assert "plain" in hints
