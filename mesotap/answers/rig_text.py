"""A first rig file, written from what a recording shows, with a comment at everything that somebody has to look at."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise

from analysis.mismatch.recordings.determined import undetermined
from analysis.mismatch.recordings.first_look import IN_SI, FirstLook
from daq.exchange.units import is_known_unit, kind_of_motion
from mesotap.configuration.rig_files import parse_rig

ROUNDS = 8  # of declaring what the channels leave open


@dataclass(slots=True)
class Draft:
    """What a rig file is going to say: masses and gains that have to be given, and why."""

    look: FirstLook
    files: tuple[str, ...]
    rate_hz: float | None
    bodies: int
    masses: dict[str, str] = field(default_factory=dict)
    gains: dict[str, str] = field(default_factory=dict)

    @property
    def names(self) -> list[str]:
        """Names of the bodies."""
        return [f"body {i + 1}" if self.bodies > 1 else "body" for i in range(self.bodies)]


def first_rig(look: FirstLook, files: Sequence[str], rate_hz: float | None = None) -> str:
    """Return the text of a rig file for recordings that look like this.

    A chain of as many bodies as modes are seen, its first one to the ground; of masses and gains so many are given as
    the channels cannot tell.

    Parameters
    ----------
    rate_hz
        Sampling rate, where the files do not say it.
    """
    draft = Draft(look, tuple(files), rate_hz, min(max(len(look.modes_hz), 1), 4))
    for i, name in enumerate(draft.names):
        draft.masses[name] = "1" if i == 0 or look.free else "unknown"
    for i, _ in enumerate(look.inputs):
        draft.gains[f"gain of input {i + 1}"] = "unknown"
    for _ in range(ROUNDS):
        open_ = [u.name for u in undetermined(parse_rig(_text(draft), "the first rig file"))]
        masses = [n for n in draft.names if f"mass of {n}" in open_]
        gains = [n for n in draft.gains if n in open_]
        if not masses and not gains:
            break
        draft.masses |= dict.fromkeys(masses, "1")
        draft.gains |= dict.fromkeys(gains, "1")
    return _text(draft)


def _text(draft: Draft) -> str:
    look = draft.look
    return "\n".join(
        [
            f"# A first description of the rig of {', '.join(draft.files)}, by 'mesotap rig init'.",
            *(f"# {line}" for line in seen(look)),
            "# Look at every line; then 'mesotap rig check', then 'mesotap diagnose --rig'. See docs/rigs.md.",
            "name: rig",
            "",
            "# A mass that is given sets the scale of all stiffnesses and dampings: give the true one if you know it.",
            "bodies:",
            *(f"  {name}: {mass}" for name, mass in draft.masses.items()),
            "",
            "# What holds them; stiffness and damping are fitted where nothing is said. What may rub is a slide, what",
            "# may part a contact, what is bolted a joint, the rest a spring.",
            "joints:",
            *_joints(draft),
            *_inputs(draft),
            "",
            *_sensors(draft),
            "",
            *_recording(draft),
            "",
        ]
    )  # fmt: skip


def seen(look: FirstLook) -> list[str]:
    """Say what a recording shows, a line for each thing."""
    kind = "a free decay" if look.free else "driven" if look.inputs else "neither driven by a channel nor a decay"
    lines = [f"{look.samples} samples at {look.rate_hz:g} Hz ({look.samples / look.rate_hz:.3g} s), {kind}"]
    modes = ", ".join(f"{hz:.4g}" for hz in look.modes_hz)
    lines.append(f"modes seen: {modes} Hz" if modes else "modes seen: none")
    if look.period_s:
        lines.append(f"the input repeats itself after {look.period_s:.4g} s")
    if not look.free and not look.inputs:
        lines.append(
            "without its input such a recording tells no physics: name the input's column with --input, or take a free "
            "decay"
        )
    for c in look.channels:
        lines.append(
            f"{c.name}: rms {c.rms:.3g} {c.unit}".rstrip() + f", {100 * c.unpredictable:.2g} % of it unpredictable"
        )
        if c.rms == 0:
            lines[-1] = f"{c.name}: constant, it shows nothing"
        if c.step:
            lines.append(f"{c.name}: goes in steps of {c.step:.3g} {c.unit}".rstrip())
        if c.clipped:
            lines.append(f"{c.name}: {c.clipped} samples are stuck at its largest or smallest value: clipped?")
    return lines


def _joints(draft: Draft) -> list[str]:
    pairs = pairwise(["ground", *draft.names])
    return [f"  - {{name: joint {i}, between: [{b}, {a}]}}" for i, (a, b) in enumerate(pairs, start=1)]


def _inputs(draft: Draft) -> list[str]:
    inputs = draft.look.inputs
    if not inputs:
        return []
    lines = [
        "",
        "# What is measured of the excitation. A gain of 1 takes it as it is in the file (N, m/s2).",
        "inputs:",
    ]
    for i, c in enumerate(inputs):
        acts = "base_acceleration: true" if c.kind == "base acceleration" else f"force_on: {draft.names[0]}"
        comment = "" if c.told else "   # a guess: the channel that its own past tells least of"
        gain = draft.gains[f"gain of input {i + 1}"]
        lines.append(f"  - {{channel: {_quoted(c.name)}, {acts}, gain: {gain}}}{comment}")
    return lines


def _sensors(draft: Draft) -> list[str]:
    lines = ["sensors:"]
    for i, c in enumerate(s for s in draft.look.sensors if s.rms > 0):
        of = draft.names[min(i, draft.bodies - 1)]
        unit = f", unit: {_quoted(c.unit)}" if c.unit else ""
        comment = "" if c.told else "   # the file does not tell what it shows"
        if not is_known_unit(c.unit) or kind_of_motion(c.unit) not in ("", c.quantity):
            unit, comment = "", f"   # {c.quantity} is a guess: the file's unit is {_quoted(c.unit)}"
        if c.unit in IN_SI:
            unit, comment = f"{unit}, gain: {IN_SI[c.unit]:g}", f"   # {c.unit} of the file in a metre of the rig"
        lines.append(f"  - {{channel: {_quoted(c.name)}, of: {of}, shows: {c.quantity}{unit}}}{comment}")
    return lines


def _recording(draft: Draft) -> list[str]:
    look, rate = draft.look, [f"  rate_hz: {draft.rate_hz:g}"] if draft.rate_hz else []
    if look.free:
        heads = ["recording:", *rate] if rate else ["# recording:"]
        return [*heads, "#   from_s: 0.01   # where the decay begins; after its largest deflection without"]
    return [
        "# Between its samples an input has no content above half the rate; 'zero' for one that a converter holds.",
        "recording:",
        *rate,
        "  hold: band-limited",
        f"  # held_out: [{{name: last quarter, from_s: {0.75 * look.samples / look.rate_hz:.4g}}}]",
    ]


def _quoted(text: str) -> str:
    return '"' + text.replace("\\", "\\\\").replace('"', '\\"') + '"'
