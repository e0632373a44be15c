"""Sensors, clocks, impactors and bodies that no list of mechanisms holds."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mesotap.proof.generator.bodies import attached
from mesotap.proof.generator.effect import Character, Effect, impulses, typical_reading, with_body, with_law
from mesotap.proof.generator.integration import Machine
from mesotap.proof.generator.nature import Nature, at, no_powers
from mesotap.proof.generator.outside import SPRINGS, spread
from mesotap.proof.generator.plan import PRETRIGGER, Plan
from mesotap.proof.generator.unlisted_laws import Unlisted

Real = NDArray[np.float64]

PLAYS = (0.1, 0.3, 0.6, 1.0)  # of the widest
HEAVIEST_KG = 0.03  # of an impactor beside the one that taps


def _chosen(c: Character) -> tuple[str, ...]:
    return tuple("AB"[i] for i in c["channels"])


def _draw_channels(rng: np.random.Generator, plan: Plan) -> Character:
    """One channel or both."""
    return {"channels": [[0], [1], [0, 1]][int(rng.integers(3))], "reading": typical_reading(plan)}


def _distorted(y: Real, c: Character, shown: Real) -> Real:
    out = y.copy()
    out[:, c["channels"]] = shown[:, c["channels"]]
    return out


def _compressed(y: Real, plan: Plan, s: float, c: Character) -> Real:
    """A sensor that saturates: y / sqrt(1 + (y / Y)^2), the largest it can show being Y = reading / s."""
    return _distorted(y, c, y / np.sqrt(1 + (s * y / c["reading"]) ** 2))


def _curved(y: Real, plan: Plan, s: float, c: Character) -> Real:
    """A sensor whose gain grows with what it shows: y + s y^2 / reading."""
    return _distorted(y, c, y + s * y**2 / c["reading"])


@njit
def _plays(y: Real, widths: Real) -> Real:
    """Return what the mean of play operators of half ``widths`` makes of ``y``, from rest."""
    out = np.empty_like(y)
    held = np.zeros(widths.size)
    for i in range(y.size):
        total = 0.0
        for j in range(widths.size):
            held[j] = min(max(held[j], y[i] - widths[j]), y[i] + widths[j])
            total += held[j]
        out[i] = total / widths.size
    return out


def _loose(seen: Real, plan: Plan, s: float, c: Character) -> Real:
    """A mount with hysteresis: the share s of the acceleration passes through plays (Prandtl and Ishlinskii)."""
    out, channel = seen.copy(), c["channels"][0]
    widths = c["play"] * c["reading"] * np.array(PLAYS)
    for i in range(len(out)):
        out[i, channel] = (1 - s) * seen[i, channel] + s * _plays(np.ascontiguousarray(seen[i, channel]), widths)
    return out


def _draw_loose(rng: np.random.Generator, plan: Plan) -> Character:
    return {
        "channels": [int(rng.integers(2))], "reading": typical_reading(plan), "play": spread(rng, 0.1, 0.5)
    }  # fmt: skip


def _drifting_clock(plan: Plan, s: float, c: Character) -> Real:
    """B's clock starts with the record and is slow by the share ``sign`` s: it takes sample j at (1 + sign s) j."""
    return np.asarray(-c["sign"] * s * (PRETRIGGER + np.arange(plan.samples)))


def _stays(machine: Machine, plan: Plan, s: float, c: Character) -> Machine:
    """Behind the tap's pulse a mass s on a soft pad arrives and stays for about ``c["lasting_s"]``."""
    stiffness = s * (np.pi / c["lasting_s"]) ** 2
    return _with_impactor(machine, s, stiffness, 0.0, 0.0, c["speeds"])


def _rebounds(machine: Machine, plan: Plan, s: float, c: Character) -> Machine:
    """A mass s on a hard tip, thrown with the tap and pushed by the hand, bounces."""
    stiffness = s * (np.pi / c["lasting_s"]) ** 2
    return _with_impactor(machine, s, stiffness, c["loss_s_per_m"], s * c["push_m_per_s2"], c["speeds"])


def _with_impactor(machine: Machine, mass: float, stiffness: float, loss: float, push: float, speeds: Real) -> Machine:
    b = machine.mass.size
    none = np.zeros(b + 1)
    machine = with_body(machine, mass, none, 0.0, 0.0)
    between, alone = none.copy(), none.copy()
    between[0], between[-1], alone[-1] = -1.0, 1.0, 1.0
    machine = with_law(machine, Unlisted.TOUCHING, between, np.array([0.0, 0.0, 0.0, stiffness, loss]))
    if push:
        machine = with_law(machine, Unlisted.HELD, alone, np.array([0.0, 0.0, 0.0, push]))
    thrown = np.zeros((machine.stiffness.shape[0], b + 1)) if machine.thrown is None else machine.thrown.copy()
    thrown[:, -1] = speeds
    return replace(machine, thrown=thrown)


def _draw_staying(rng: np.random.Generator, plan: Plan) -> Character:
    """Speeds at which ``HEAVIEST_KG`` would give the momentum of the tap itself."""
    speeds = impulses(plan) / HEAVIEST_KG * np.exp(0.15 * rng.standard_normal(plan.group.size))
    return {"lasting_s": float(rng.uniform(1.3e-3, 1.7e-3)), "speeds": speeds}


def _draw_rebounds(rng: np.random.Generator, plan: Plan) -> Character:
    speeds = impulses(plan) / HEAVIEST_KG * np.exp(0.15 * rng.standard_normal(plan.group.size))
    flight = float(rng.uniform(4e-3, 9e-3))
    return {
        "lasting_s": float(rng.uniform(0.2e-3, 0.4e-3)),
        "loss_s_per_m": float(rng.uniform(0.1, 0.4)) / float(np.median(speeds)),
        "push_m_per_s2": 2 * float(np.median(speeds)) / flight, "speeds": speeds,
    }  # fmt: skip


def _on_a_beam(machine: Machine, plan: Plan, s: float, c: Character) -> Machine:
    """Both tube springs stand on a beam whose mode moves their feet by ``c["shape"]``; its modal mass is 1/s kg."""
    angular = 2 * math.pi * c["frequency_hz"]
    ground = np.zeros(machine.mass.size + 1)
    ground[-1] = 1.0
    machine = with_body(machine, 1 / s, ground, angular**2 / s, 2 * c["zeta"] * angular / s)
    stiffness = machine.stiffness.copy()
    for i, moved in enumerate(c["shape"]):
        stiffness[:, i, -1] -= plan.springs[i] * moved
        stiffness[:, -1, i] -= plan.springs[i] * moved
        stiffness[:, -1, -1] += plan.springs[i] * moved**2
    return replace(machine, stiffness=stiffness)


def _draw_beam(rng: np.random.Generator, plan: Plan) -> Character:
    """The feet move against each other, one less than the other; with each other they would be one foot to a decay."""
    other = -float(rng.uniform(0.3, 0.8))
    return {
        "frequency_hz": spread(rng, 100.0, 700.0), "zeta": float(rng.uniform(0.005, 0.02)),
        "shape": [1.0, other] if rng.uniform() < 0.5 else [other, 1.0],
    }  # fmt: skip


def _two_parts(machine: Machine, plan: Plan, s: float, c: Character) -> Machine:
    for frequency, zeta, share in zip(c["frequencies_hz"], c["zetas"], c["shares"], strict=True):
        machine = attached(machine, plan, s * share, {"frequency_hz": frequency, "zeta": zeta})
    return machine


def _draw_two_parts(rng: np.random.Generator, plan: Plan) -> Character:
    """Two parts at frequencies a quarter apart at least."""
    low = float(rng.uniform(1200, 2800))
    share = float(rng.uniform(0.35, 0.65))
    return {
        "frequencies_hz": [low, low * float(rng.uniform(1.25, 1.8))],
        "zetas": rng.uniform(0.01, 0.04, 2).tolist(), "shares": [share, 1 - share],
    }  # fmt: skip


CHAIN = (
    Effect(
        "sensor_compression", "sensor chain", 0.1, 2.0,
        lambda p, s, c: {"saturation_m_s2": c["reading"] / s, "channels": "".join(_chosen(c))},
        draw=_draw_channels, sensed=_compressed, listed=False,
        nature=Nature(
            "sensor", _chosen, no_powers, same=("sensor_curvature",),
            why="its cubed share is the first term of the saturation",
        ),
    ),
    Effect(
        "curved_sensors", "sensor chain", 0.01, 0.5,
        lambda p, s, c: {"squared_per_m_s2": s / c["reading"], "channels": "".join(_chosen(c))},
        draw=_draw_channels, sensed=_curved, listed=False,
        nature=Nature(
            "sensor", _chosen, no_powers, same=("sensor_curvature",), why="it has the same equation, its squared share",
        ),
    ),
    Effect(
        "clock_of_b", "sensor chain", 1e-5, 2e-3, lambda p, s, c: {"clock_error_of_b_ppm": c["sign"] * s * 1e6},
        draw=lambda rng, plan: {"sign": float(rng.choice([-1.0, 1.0]))}, delay=_drifting_clock, listed=False,
        nature=Nature("clock", at("B", "A")),
    ),
    Effect(
        "mount_hysteresis", "sensor chain", 0.01, 0.8,
        lambda p, s, c: {
            "hysteretic_share": s, "plays_m_s2": [c["play"] * c["reading"] * w for w in PLAYS],
            "channels": "".join(_chosen(c)),
        },
        draw=_draw_loose, mounted=_loose, listed=False, nature=Nature("sensor", _chosen),
    ),
)  # fmt: skip
"""Effects in the sensor chain."""

OTHERS = (
    Effect(
        "staying_impactor", "impactor", 1e-3, HEAVIEST_KG,
        lambda p, s, c: {"impactor_kg": s, "pad_n_per_m": s * (np.pi / c["lasting_s"]) ** 2},
        draw=_draw_staying, machined=_stays, listed=False, nature=Nature("input", at("impactor", "upper mass")),
    ),
    Effect(
        "rebounds", "impactor", 1e-4, HEAVIEST_KG,
        lambda p, s, c: {
            "impactor_kg": s, "tip_n_per_m": s * (np.pi / c["lasting_s"]) ** 2, "loss_s_per_m": c["loss_s_per_m"],
            "push_n": s * c["push_m_per_s2"],
        },
        draw=_draw_rebounds, machined=_rebounds, listed=False,
        nature=Nature(
            "input", at("impactor", "upper mass"), same=("double_hit",),
            why="each rebound is a second hit; the others belong to the remainder",
        ),
    ),
    Effect(
        "frame_beam", "frame", 0.05, 10.0,
        lambda p, s, c: {
            "modal_mass_kg": 1 / s, "frequency_hz": c["frequency_hz"], "zeta": c["zeta"], "shape": c["shape"],
        },
        draw=_draw_beam, machined=_on_a_beam, listed=False,
        nature=Nature(
            "dynamics", at("frame", *SPRINGS), components=("tube springs",)
        ),
    ),
    Effect(
        "two_attached_parts", "lower mass", 1e-3, 0.03,
        lambda p, s, c: {
            "attached_kg": [s * share for share in c["shares"]], "frequencies_hz": c["frequencies_hz"],
            "zetas": c["zetas"],
        },
        draw=_draw_two_parts, machined=_two_parts, listed=False,
        nature=Nature(
            "dynamics", at("lower mass"), same=("attached_mass",), why="either part is one; the other is the remainder",
        ),
    ),
)  # fmt: skip
"""Impactors and bodies."""
