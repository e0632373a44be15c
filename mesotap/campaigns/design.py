"""The design of a sweep: simulated sessions of every combination of settings, from a YAML."""

from __future__ import annotations

import itertools
import json
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pydantic
import yaml

from mesotap.campaigns.campaign import seed_of
from mesotap.campaigns.errors import CampaignError
from mesotap.campaigns.task import Task, content_sha256
from mesotap.configuration.config import ConfigError, effective_text, parse_config, text_of
from mesotap.configuration.yaml_text import NOT_YAML, not_yaml, parsed

CONFIG, RESULTS, DIAGNOSIS = "config.yaml", "results.json", "session/diagnosis.json"
EMPTY = (
    "is empty, and says nothing to try; write for example 'vary: {mesotap.impacts_per_load: [4, 8]}', or 'repeats: 10' "
    "for sessions that differ by chance alone"
)
LARGEST_SWEEP = 1_000_000  # sessions; beyond it a design is a slip of the pen


class Design(pydantic.BaseModel):
    """What a sweep's YAML holds.

    Attributes
    ----------
    title
        What is to be found out, one line.
    seed
        From which the seed of each session is drawn.
    repeats
        Sessions of each combination.
    config
        Configuration that they have in common, beside the YAML; the defaults without.
    set
        Key to value that all have in common, such as ``mesotap.impacts_per_load: 4``.
    vary
        Key to the values that are tried, each with each of the others'.
    diagnose
        Whether each session is diagnosed too.
    """

    model_config = pydantic.ConfigDict(extra="forbid", strict=True)

    title: str = pydantic.Field("sweep", min_length=1, max_length=200, pattern=r"^[^\r\n]*$")
    seed: int = pydantic.Field(1, ge=0)
    repeats: int = pydantic.Field(1, ge=1)
    config: str | None = None
    set: dict[str, Any] = {}
    vary: dict[str, list[Any]] = {}
    diagnose: bool = False

    @pydantic.model_validator(mode="after")
    def _each_key_once(self) -> Design:
        for key in self.vary:
            if key in self.set:
                raise ValueError(f"{key} stands in set and in vary: the value in set would not count, take it out")
        return self

    @pydantic.field_validator("vary")
    @classmethod
    def _something_is_varied(cls, vary: dict[str, list[Any]]) -> dict[str, list[Any]]:
        for key, values in vary.items():
            if not values:
                raise ValueError(f"{key}: has no values")
        return vary


@dataclass(frozen=True, slots=True)
class Planned:
    """A session of a sweep: what is varied, its seed, its task, and the configuration that is its input."""

    factors: Mapping[str, Any]
    seed: int
    task: Task
    config: bytes


def read_design(path: Path) -> Design:
    """Read the design of a sweep.

    Raises
    ------
    CampaignError
        It is none; the message has a fault for each key.
    """
    try:
        _, content = parsed(text_of(path, "the design of a sweep"))
    except ConfigError as error:
        raise CampaignError(str(error)) from error
    except NOT_YAML as error:
        raise CampaignError(not_yaml(str(path), error)) from error
    if content is None or content == {}:
        raise CampaignError(f"{path}: {EMPTY}")
    try:
        return Design.model_validate(content)
    except pydantic.ValidationError as error:
        faults = [f"{'.'.join(map(str, e['loc'])) or 'the design'}: {e['msg']}" for e in error.errors()]
        raise CampaignError(f"{path}: {'; '.join(faults)}") from error


def planned(design: Design, path: Path) -> Iterator[tuple[str, Planned]]:
    """Return name and content of each session of a design that was read from ``path``.

    Raises
    ------
    CampaignError
        A combination is no valid configuration; the message says which and why.
    """
    sessions = design.repeats * math.prod(len(values) for values in design.vary.values())
    if sessions > LARGEST_SWEEP:
        raise CampaignError(f"{path}: asks for {sessions:,} sessions, more than {LARGEST_SWEEP:,}")
    base = "" if design.config is None else text_of(path.parent / design.config, "a configuration")
    width = len(str(max(sessions - 1, 0)))
    index = itertools.count()
    for values in itertools.product(*design.vary.values()):
        factors = dict(zip(design.vary, values, strict=True))
        settings = {**design.set, **factors, "mesotap.diagnose": design.diagnose}
        changes = [
            f"{key}={yaml.safe_dump(value, default_flow_style=True, width=math.inf)}" for key, value in settings.items()
        ]
        try:
            config = effective_text(parse_config(base, design.config or "the defaults", changes)).encode()
        except ConfigError as error:
            shown = ", ".join(f"{key}: {json.dumps(value)}" for key, value in factors.items())
            raise CampaignError(f"{path}: {shown or 'set'}: {error}") from error
        for _ in range(design.repeats):
            i = next(index)
            yield f"{i:0{width}}", _session(factors, seed_of(design.seed, i), config, design.diagnose)


def _session(factors: Mapping[str, Any], seed: int, config: bytes, diagnose: bool) -> Planned:
    arguments = ("run", "--simulate", "--seed", str(seed), "--config", CONFIG)
    task = Task(
        (*arguments, "--output", "session", "--json", RESULTS),
        {CONFIG: content_sha256(config)},
        (RESULTS, DIAGNOSIS) if diagnose else (RESULTS,),
    )
    return Planned(factors, seed, task, config)
