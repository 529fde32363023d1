"""Recorded runs, replayed through each component: it publishes the same, or the change is meant: `make references`."""

from dataclasses import replace
from pathlib import Path

import pytest

from dlokit.communication import topics
from dlokit.errors import InputError
from dlokit.recording.comparison import FieldRow
from dlokit.recording.reader import read_recording
from dlokit.skills.observer.config import ObserverConfig
from dlokit.skills.observer.spr import SprConfig
from dlokit.system.config import RunConfig
from dlokit.system.configuration.recorded import recorded_config, recorded_toml
from dlokit.system.replay import Replay, replay, replayable

FOLDER = Path(__file__).with_name("references")
REFERENCES = sorted(path.stem for path in FOLDER.glob("*.mcap"))
WITH_PICTURES = "farthest"
LARGEST_BYTES = 1_000_000  # they are in the repository and renewed often

HINT = "if the change is meant, renew the references with `make references`, and say in the commit what changed"


def replayed(name: str, component: str) -> Replay:
    path = FOLDER / f"{name}.mcap"
    return replay(path, component, recorded_config(path, replayable()[component]))


def beyond(rows: list[FieldRow]) -> list[str]:
    return [f"{row.what} {row.field}: {row.largest:g}, allowed {row.allowed:g}" for row in rows if not row.within]


@pytest.mark.parametrize("component", ["observer", "model", "planning"])
@pytest.mark.parametrize("name", REFERENCES)
def test_a_replayed_component_repeats_its_recorded_behaviour(name: str, component: str) -> None:
    done = replayed(name, component)
    assert not beyond(done.rows), HINT
    said = {row.what: row.compared for row in done.rows if row.field == "(messages)"}
    least = {"observer": ("observer/targets", 8), "model": ("model/state", 15), "planning": ("planning/action", 1)}
    what, count = least[component]
    assert said[what] >= count
    assert any(row.field == "outcome" and row.what.startswith(component) for row in done.rows)
    assert done.unknown_calls == 0


def test_perception_replayed_from_a_runs_images_repeats_its_clouds() -> None:
    done = replayed(WITH_PICTURES, "perception")
    assert not beyond(done.rows), HINT
    compared = {(row.what, row.field): row.compared for row in done.rows}
    assert compared["perception/cloud", "points_world"] == 2  # as many as there are pictures
    assert compared["perception.look", "outcome"] > 2
    assert done.left_out > 0


def test_another_observer_is_detected() -> None:
    path = FOLDER / f"{WITH_PICTURES}.mcap"
    config = replace(recorded_config(path, replayable()["observer"]), observer=ObserverConfig(strategy=SprConfig()))
    assert any(row.what == "observer/targets" and not row.within for row in replay(path, "observer", config).rows)


def test_a_setting_of_another_version_prevents_only_the_replay_of_its_component() -> None:
    path = FOLDER / "wire.mcap"
    text = recorded_toml(path)
    assert "[cell" in text  # a setting of no replayed component
    config = recorded_config(path, replayable()["model"])
    assert config.cell == RunConfig().cell
    assert config.model != RunConfig().model


def test_perception_cannot_be_replayed_without_images() -> None:
    with pytest.raises(InputError, match=r"no pictures.*another component"):
        replayed("wire", "perception")


def test_the_references_are_small_and_without_the_true_shape() -> None:
    assert len(REFERENCES) == 3
    for name in REFERENCES:
        path = FOLDER / f"{name}.mcap"
        assert path.stat().st_size < LARGEST_BYTES
        known = {topic.name for topic in topics.TOPICS} | {"skill_calls", "skill_calls_begun"}
        assert {one.topic for one in read_recording(path)} <= known


def test_the_command_line_lists_the_components_that_can_be_replayed() -> None:
    assert set(replayable()) == {"perception", "observer", "model", "planning"}
