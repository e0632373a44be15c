"""Whatever stands in a file that describes a rig, it is taken or refused in sentences."""

from __future__ import annotations

from pathlib import Path

import yaml

from analysis.mismatch.rig_description import DescribedRig
from mesotap.configuration.config import ConfigError
from mesotap.configuration.rig_files import parse_rig
from tests.fuzz.configs import Edits, places, put, value
from tests.fuzz.mutations import Content, Damage, damaged, damages
from tests.fuzz.source import Source, Target

SOUND = """\
name: two masses
bodies: {upper: 0.107, lower: {value: 0.108, uncertainty: 0.001}}
springs:
  - {between: [upper, ground], stiffness: 5.0e+5}
  - {between: [lower, ground], stiffness: {per: load, symbol: k2}, component: tube springs, alike: feet}
dampers:
  - {between: [lower, ground], damping: 0.1}
contacts:
  - {between: [upper, lower], name: the contact, preload: 0.4, damping: {header: k1_n_per_m}}
tapped: upper
inputs:
  - {channel: force, force_on: upper, gain: 1.0}
sensors:
  - {channel: a, of: lower, shows: acceleration, unit: m/s2}
  - {channel: 2, of: {upper: 1, lower: -1}, shows: displacement, gain: unknown, offset: 0}
recording:
  rate_hz: 25000
  from_s: 0.1
  held_out:
    - {name: the end, from_s: 1, to_s: 2}
units: {length: m, force: N}
sweeps: {frequency: f, force: F, amplitude: x, phase: p, of: lower, shows: acceleration}
"""
WHOLE = yaml.safe_load(SOUND)
PLACES = places(WHOLE)[1:]


def taken_or_refused(text: str) -> None:
    try:
        rig = parse_rig(text, "some.yaml")
    except ConfigError as error:
        assert str(error)
        for line in str(error).splitlines():
            assert line.startswith("some.yaml"), line
            assert len(line) < 2000
        return
    assert isinstance(rig, DescribedRig)


def damaged_rig_file(place: Path) -> Target:
    sound = Content(SOUND.encode())

    def check(damage: Damage) -> None:
        taken_or_refused(damaged(sound, damage).decode("utf-8", "replace"))

    return Target(damages(8), check)


def any_value_at_any_key(place: Path) -> Target:
    def draw(source: Source) -> Edits:
        return source.several(lambda inner: (inner.choice(PLACES), value(inner)), 1, 3)

    def check(edits: Edits) -> None:
        content: object = WHOLE
        for at, other in edits:
            content = put(content, at, other)
        try:
            text = yaml.safe_dump(content, allow_unicode=True)
        except (yaml.YAMLError, TypeError, ValueError):  # keys that cannot be sorted, or integers too long to print
            return
        taken_or_refused(text)

    return Target(draw, check)


TARGETS = (damaged_rig_file, any_value_at_any_key)
