"""Effects outside the list against an independent integration of their equations, as their truths state them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline

from mesotap.proof.generator.concealed import Concealed, Hidden, signals
from mesotap.proof.generator.effects import HIDING, OUTSIDE
from mesotap.proof.generator.integration import integrate
from mesotap.proof.generator.nature import KINDS_OF_LAW
from mesotap.proof.generator.outside_ground import fractional_branches
from mesotap.proof.generator.plan import PRETRIGGER, Plan, machine_of, random_plan
from mesotap.proof.generator.survival import refit

Real = NDArray[np.float64]
Told = Mapping[str, Any]

LASTING_S = 8e-3  # of a motion that is integrated twice
CLOSE = 5e-3  # of what the effect changes
OF_BRANCHES = 2e-2  # the same, of a fractional derivative that branches stand for
EXACT = 1e-10  # relative tolerance of the independent integration


def one_tap(seed: int = 5) -> Plan:
    """A plan with one tap at its first load."""
    plan = random_plan(np.random.default_rng(seed))
    return replace(
        plan,
        loads=plan.loads[:1],
        kc=plan.kc[:1],
        cc=plan.cc[:1],
        group=np.array([0]),
        pulses=plan.pulses[:1],
        offset=plan.offset[:1],
        samples=400,
    )


@dataclass
class Motion:
    """Places and rates of both masses, the contact's deformation and rate, and further states."""

    t: float
    x: Real
    v: Real
    d: float
    rate: float
    z: Real


Forces = tuple[float, float, float]
"""On the upper and the lower mass, and in the contact (positive pushes apart), N."""
Law = Callable[[Motion, Told], tuple[Forces, list[float]]]


def tap(t: float, shape: Real) -> float:
    """Force of a tap, N."""
    u = t / shape[1]
    return float(shape[2] * np.sin(np.pi * u ** shape[4]) ** shape[3]) if 0 < u < 1 else 0.0


def integrated(plan: Plan, law: Law, told: Told, begin: list[float], times: Real) -> Real:
    """Return the lower mass's acceleration at the times, from Newton's equations."""
    (m1, m2), (k1, k2), kc, cc = plan.masses, plan.springs, plan.kc[0], plan.cc[0]
    shape = plan.pulses[0, 0]

    def slope(t: float, y: Real) -> Real:
        x, v, z = y[:2], y[2:4], y[4:]
        d, rate = x[0] - x[1], v[0] - v[1]
        (upper, lower, between), more = law(Motion(t, x, v, d, rate, z), told)
        contact = kc * d + cc * rate + between
        a1 = (tap(t, shape) - k1 * x[0] - contact + upper) / m1
        a2 = (-k2 * x[1] + contact + lower) / m2
        return np.array([v[0], v[1], a1, a2, *more])

    y, found, began = np.array([0.0] * 4 + begin), [], 0.0
    for until in (shape[1], times[-1]):  # the tap's end is a kink
        inside = times[(times >= began) & ((times < until) | (until == times[-1]))]
        size = np.r_[np.full(2, 1e-7), np.full(2, 1e-3), np.full(len(begin), 1e-7)]
        seen = np.unique(np.r_[inside, until])
        done = solve_ivp(slope, (began, until), y, "DOP853", seen, rtol=EXACT, atol=EXACT * size)
        found += [slope(t, state)[3] for t, state in zip(inside, done.y.T, strict=False)]
        y, began = done.y[:, -1], until
    return np.array(found)


def contact(force: Callable[[Motion, Told], float]) -> Law:
    """A force in the contact without further states."""
    return lambda m, told: ((0.0, 0.0, float(force(m, told))), [])


def ground(force: Callable[[float, float, Motion, Told], float]) -> Law:
    """A force of a mass's place and rate that pushes it back to the ground."""

    def law(m: Motion, told: Told) -> tuple[Forces, list[float]]:
        mass = told.get("mass", 0)
        pushed = -float(force(m.x[mass], m.v[mass], m, told))
        return ((pushed, 0.0, 0.0) if mass == 0 else (0.0, pushed, 0.0)), []

    return law


def bouc_wen(m: Motion, told: Told) -> tuple[Forces, list[float]]:
    """Bouc and Wen: z' = v - |z/z0|^n (beta |v| sign z + gamma v), its elastic part being the contact's own."""
    z, size = float(m.z[0]), abs(m.z[0] / told["reach_m"]) ** told["exponent"]
    slope = m.rate - size * (told["beta"] * abs(m.rate) * np.sign(z) + told["gamma"] * m.rate)
    return (0.0, 0.0, told["hysteretic_stiffness_n_per_m"] * (z - m.d)), [float(slope)]


def met(m: Motion, told: Told) -> float:
    """A spring beyond a clearance."""
    beyond = abs(m.d) - told["clearance_m"]
    return float(told["met_stiffness_n_per_m"] * max(beyond, 0.0) * np.sign(m.d))


def exponential(m: Motion, told: Told) -> float:
    u = m.d / told["range_m"]
    return float(told["exponential_stiffness_n_per_m"] * told["range_m"] * (np.exp(u) - 1 - u))


def sliding(v: float, told: Told) -> float:
    return float(told["sliding_n"] + told["more_at_rest_n"] * np.exp(-((v / told["stribeck_rate_m_per_s"]) ** 2)))


def stribeck(x: float, v: float, m: Motion, told: Told) -> float:
    return float(sliding(v, told) * np.tanh(v / told["rounded_m_per_s"]) + told["rising_n_s_per_m"] * v)


def lugre(m: Motion, told: Told) -> tuple[Forces, list[float]]:
    v, z = float(m.v[0]), float(m.z[0])
    slope = v - told["bristles_n_per_m"] * abs(v) / sliding(v, told) * z
    return (-told["bristles_n_per_m"] * z - told["bristles_n_s_per_m"] * slope, 0.0, 0.0), [slope]


def maxwell(m: Motion, told: Told) -> tuple[Forces, list[float]]:
    """A damper in series with a spring, whose stretch is the state."""
    mass, stretch = told["mass"], float(m.z[0])
    pull = -told["branch_n_per_m"] * stretch
    return ((pull, 0.0, 0.0) if mass == 0 else (0.0, pull, 0.0)), [m.v[mass] - stretch / told["time_s"]]


def thrown(m: Motion, told: Told) -> tuple[Forces, list[float]]:
    """A further mass: place and rate are the states."""
    y, w = m.z
    tip = told.get("tip_n_per_m", told.get("pad_n_per_m", 0.0))
    push = max(tip * (y - m.x[0]) * (1 + told.get("loss_s_per_m", 0.0) * (w - m.v[0])), 0.0) if y > m.x[0] else 0.0
    return (push, 0.0, 0.0), [w, (told.get("push_n", 0.0) - push) / told["impactor_kg"]]


def beam(m: Motion, told: Told) -> tuple[Forces, list[float]]:
    """A mode of the frame, q: the feet of the springs move by shape times q."""
    (k1, k2), (f1, f2), (q, w) = told["springs"], told["shape"], m.z
    angular = 2 * np.pi * told["frequency_hz"]
    pull = k1 * f1 * (m.x[0] - f1 * q) + k2 * f2 * (m.x[1] - f2 * q)
    slope = pull / told["modal_mass_kg"] - angular**2 * q - 2 * told["zeta"] * angular * w
    return (k1 * f1 * q, k2 * f2 * q, 0.0), [w, slope]


def parts(m: Motion, told: Told) -> tuple[Forces, list[float]]:
    """Two resonators on the lower mass."""
    force, slopes = 0.0, []
    for i in range(2):
        y, w = m.z[2 * i : 2 * i + 2]
        angular, mass = 2 * np.pi * told["frequencies_hz"][i], told["attached_kg"][i]
        back = mass * (angular**2 * (y - m.x[1]) + 2 * told["zetas"][i] * angular * (w - m.v[1]))
        force += back
        slopes += [w, -back / mass]
    return (0.0, force, 0.0), slopes


def modulated(m: Motion, told: Told) -> float:
    return float(told["amplitude_n_per_m"] * np.sin(2 * np.pi * told["frequency_hz"] * m.t + told["phases"][0]) * m.d)


RATES = np.exp(np.arange(0.0, 14.5, 0.3))
"""Rates (1/s) at which the integral that is a fractional derivative is evaluated."""


def fractional(m: Motion, told: Told) -> tuple[Forces, list[float]]:
    """(i w)^a = sin(pi a) / pi times the integral over r of r^(a - 1) i w / (i w + r), by the trapezoidal rule.

    Below the lowest rate every branch is a spring, above the highest one a damper.
    """
    mass, a = told["mass"], told["order"]
    x, v, low, high = m.x[mass], m.v[mass], RATES[0], RATES[-1]
    weights = 0.3 * RATES**a
    weights[[0, -1]] /= 2
    total = float(weights @ (x - m.z)) + low**a / a * x + high ** (a - 1) / (1 - a) * v
    force = -told["coefficient_n_s_per_m_to_the_order"] * np.sin(np.pi * a) / np.pi * total
    return ((force, 0.0, 0.0) if mass == 0 else (0.0, force, 0.0)), list(RATES * (x - m.z))


LAWS: dict[str, tuple[Law, int, float]] = {
    "contact_cubic": (contact(lambda m, told: told["cubic_n_per_m3"] * m.d**3), 0, 0.3),
    "loaded_cubic": (
        contact(
            lambda m, told: told["cubic_n_per_m3"] * (told["p"] / told["at_load_n"]) ** told["power_of_load"] * m.d**3
        ),
        0,
        0.1,
    ),
    "contact_quadratic": (contact(lambda m, told: told["quadratic_n_per_m2"] * m.d**2), 0, 0.2),
    "contact_bilinear": (contact(lambda m, told: told["pressed_n_per_m"] * max(m.d, 0.0)), 0, 0.3),
    "contact_dead_zone": (contact(met), 0, 0.5),
    "contact_exponential": (contact(exponential), 0, 0.3),
    "cubed_rate_damping": (contact(lambda m, told: told["cubed_rate_n_s3_per_m3"] * m.rate**3), 0, 0.5),
    "fractional_rate_damping": (
        contact(
            lambda m, told: told["coefficient_n_s_per_m_to_the_power"] * abs(m.rate) ** told["power"] * np.sign(m.rate)
        ),
        0,
        0.5,
    ),
    "bouc_wen": (bouc_wen, 1, 0.3),
    "stiffness_step": (contact(lambda m, told: told["step_n_per_m"] * m.d * (m.t > told["times_s"][0])), 0, 0.3),
    "drifting_contact": (
        contact(lambda m, told: told["drift_n_per_m"] * (1 - np.exp(-m.t / told["time_s"])) * m.d),
        0,
        0.3,
    ),
    "shaken_contact": (contact(modulated), 0, 0.3),
    "modulated_contact": (contact(modulated), 0, 0.3),
    "bilinear_spring": (ground(lambda x, v, m, told: told["pressed_n_per_m"] * max(x, 0.0)), 0, 0.3),
    "drifting_spring": (
        ground(lambda x, v, m, told: told["drift_n_per_m"] * (1 - np.exp(-m.t / told["time_s"])) * x),
        0,
        0.3,
    ),
    "stribeck_friction": (ground(stribeck), 0, 0.02),
    "lugre_friction": (lugre, 1, 0.02),
    "maxwell_branch": (maxwell, 1, 0.2),
    "standard_linear_spring": (maxwell, 1, 0.2),
    "fractional_damping": (fractional, RATES.size, 0.2),
    "staying_impactor": (thrown, 2, 0.01),
    "rebounds": (thrown, 2, 0.002),
    "frame_beam": (beam, 2, 1.0),
    "two_attached_parts": (parts, 4, 0.01),
}
"""Law, number of further states, and the strength of the trial."""


def test_every_motion_is_integrated_twice() -> None:
    moved = {name for name, effect in OUTSIDE.items() if effect.machined is not None}
    assert set(LAWS) == moved


@pytest.mark.parametrize("name", sorted(LAWS))
def test_motion_is_that_of_an_independent_integration(name: str) -> None:
    plan, effect = one_tap(), OUTSIDE[name]
    law, states, strength = LAWS[name]
    character = effect.draw(np.random.default_rng(2), plan)
    if "load" in character:
        character = {**character, "load": 1.3 * character["load"]}
    if "times_s" in character:
        character = {**character, "times_s": np.array([2e-3])}  # within the motion that is looked at
    steps = round(LASTING_S / plan.step_s)
    assert effect.machined is not None
    found = integrate(effect.machined(machine_of(plan), plan, strength, character), steps, plan.step_s)[0, 0]
    without = integrate(machine_of(plan), steps, plan.step_s)[0, 0]
    every = np.arange(0, steps, 40)
    # what differs from impact to impact no truth tells
    known = {"springs": plan.springs, "p": plan.loads[0]}
    told = {**character, **known, **effect.parameters(plan, strength, character)}
    begin = [0.0, float(character["speeds"][0])] if "speeds" in character else [0.0] * states
    expected = integrated(plan, law, told, begin, every * plan.step_s)
    changed = np.abs(found - without).max()
    assert changed > 3e-3 * np.abs(without).max()
    assert np.abs(found[every] - expected).max() < (OF_BRANCHES if name == "fractional_damping" else CLOSE) * changed


def heard(name: str, strength: float, character: Mapping[str, Any]) -> tuple[Real, Real]:
    """Return the channels without and with an effect of the sensor chain, (2, samples) each."""
    plan = one_tap()
    without = signals(Concealed(plan))
    return without[0], signals(Concealed(plan, (Hidden(OUTSIDE[name], strength, character),)))[0]


def test_compressed_channel_saturates_and_the_other_does_not() -> None:
    true, found = heard("sensor_compression", 0.5, {"channels": [1], "reading": 2.0})
    np.testing.assert_array_equal(found[0], true[0])
    np.testing.assert_allclose(found[1] ** -2.0, true[1] ** -2.0 + (0.5 / 2.0) ** 2, rtol=1e-9)


def test_clock_of_b_runs_away_from_that_of_a() -> None:
    plan, error = one_tap(), 4e-3
    true, found = heard("clock_of_b", error, {"sign": -1.0})
    np.testing.assert_array_equal(found[0], true[0])
    early = error * (PRETRIGGER + np.arange(plan.samples))
    spline = CubicSpline(np.arange(plan.samples), true[1])
    middle = slice(20, -20)
    expected = spline((np.arange(plan.samples) - early)[middle])
    assert np.abs(found[1][middle] - expected).max() < 0.02 * np.abs(found[1] - true[1]).max()


def test_mount_holds_back_what_its_plays_hold_back() -> None:
    plan, effect = one_tap(), OUTSIDE["mount_hysteresis"]
    assert effect.mounted is not None
    rising = np.array([0.0, 0.02, 0.5, 1.0, 0.5, -1.0])
    seen = np.tile(rising, (1, 2, 1))
    found = effect.mounted(seen, plan, 0.5, {"channels": [0], "play": 0.1, "reading": 1.0})
    np.testing.assert_array_equal(found[0, 1], rising)
    # plays of 0.01, 0.03, 0.06 and 0.1 m/s2, on the way up behind by their width, on the way down ahead
    held = np.array([0.0, 0.01 / 4, 0.45, 0.95, 0.55, -0.95])
    np.testing.assert_allclose(found[0, 0], 0.5 * rising + 0.5 * held)


def test_branches_have_the_stiffness_of_a_fractional_derivative() -> None:
    for order in (0.2, 0.5, 0.8):
        stiffness, times = fractional_branches(order)
        w = 2 * np.pi * np.geomspace(15.0, 7000.0, 50)
        found = (stiffness * (1j * w[:, None] * times) / (1 + 1j * w[:, None] * times)).sum(axis=1)
        assert np.abs(found / (1j * w) ** order - 1).max() < 0.03


def test_what_a_decay_hides_is_no_effect_to_be_found() -> None:
    plan, effect = one_tap(), HIDING["fractional_contact_damping"]
    hidden = Hidden(effect, effect.largest, effect.draw(np.random.default_rng(1), plan))
    found = signals(Concealed(plan, (hidden,)))
    assert np.abs(found - signals(Concealed(plan))).max() > 2 * plan.noise.rms
    assert refit(plan, found).d < 1.0


def test_every_effect_says_what_a_learned_law_is_to_say() -> None:
    plan = one_tap()
    assert len(OUTSIDE) >= 20
    for name, effect in {**OUTSIDE, **HIDING}.items():
        assert effect.nature is not None, name
        assert not effect.listed
        told = effect.nature.told(effect.draw(np.random.default_rng(1), plan))
        assert told["kind"] in KINDS_OF_LAW
        assert told["elements"]
        assert set(told["exponents"]) <= {"deflection", "rate", "load"}
        assert bool(told["same"]) == bool(effect.nature.why)


def test_the_documentation_tells_what_each_effect_is() -> None:
    text = (Path(__file__).parents[3] / "docs" / "proof" / "about.md").read_text(encoding="utf-8")
    rows = {line.split("`")[1]: line.split("|") for line in text.splitlines() if line.startswith("| `")}
    assert set(rows) == set(OUTSIDE) | set(HIDING)
    for name, effect in OUTSIDE.items():
        assert effect.nature is not None
        _, _, _, kind, _, _, same, _ = (part.strip() for part in rows[name])
        assert kind == effect.nature.kind
        assert [s for s in effect.nature.same if f"`{s}`" not in same] == []
        assert bool(effect.nature.same) == bool(same and not same.startswith("none"))
