"""Effects that add bodies, springs or dampers, or an impact; the rig stays linear."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mesotap.proof.rigs.description import GROUND
from mesotap.proof.rigs.draw import Wants
from mesotap.proof.rigs.effects import Array, Effect, Hidden, Rng, chosen, grounded, together, unit, wider
from mesotap.proof.rigs.plant import Branch, Relaxing
from mesotap.proof.rigs.trial import Altered, Trial

STIFF = ("spring", "joint", "contact", "pendulum")


def _modes(trial: Trial) -> tuple[float, float]:
    """Lowest and highest natural frequency (rad/s)."""
    modes = 2 * np.pi * trial.rig.plant(trial.rig.true_values()).modes_hz()
    return float(modes[0]), float(modes[-1])


def _share_of_input(trial: Trial, mass: float) -> float:
    """Force of a unit of the input on a further body."""
    return -mass if trial.rig.input and trial.rig.input.body == GROUND else 0.0


def _attached(trial: Trial, rng: Rng) -> Hidden:
    rig = trial.rig
    body = int(rng.integers(len(rig.masses)))
    omega, ratio = _modes(trial)[1] * float(rng.uniform(0.8, 2.2)), float(rng.uniform(0.01, 0.1))

    def values(s: float) -> tuple[float, float, float]:
        mass = s * rig.masses[body].true
        return mass, mass * omega**2, 2 * ratio * omega * mass

    def add(altered: Altered, s: float) -> Altered:
        mass, k, c = values(s)
        shape = wider(unit(len(rig.masses), body), altered.plant)
        shape[-1] = -1.0
        plant = altered.plant.with_body(mass, Branch(shape, k, c), _share_of_input(trial, mass))
        return replace(altered, plant=plant)

    names = ("attached_mass_kg", "mount_stiffness_n_per_m", "mount_damping_n_s_per_m")
    return Hidden(
        "attached_mass", (rig.body(body),), "body", add, lambda s: dict(zip(names, values(s), strict=True)), start=1e-3
    )


def _frame(trial: Trial, rng: Rng) -> Hidden | None:
    rig = trial.rig
    i = chosen(rig, STIFF, rng, grounded)
    if i is None:
        return None
    element = rig.elements[i]
    mass = rig.masses[element.a].true * float(10 ** rng.uniform(-0.3, 0.7))
    stiffness = element.stiffness.true if element.stiffness else 0.0
    ratio = float(rng.uniform(0.01, 0.1))

    def values(s: float) -> tuple[float, float, float]:
        k = stiffness / s
        return mass, k, 2 * ratio * float(np.sqrt(k * mass))

    def add(altered: Altered, s: float) -> Altered:
        _, k, c = values(s)
        size = altered.plant.masses.size
        plant = altered.plant.with_body(
            mass, Branch(wider(np.zeros(0), altered.plant), k, c), _share_of_input(trial, mass)
        )
        plant.branches[-1].shape[size] = 1.0
        plant.branches[i].shape[size] = -1.0
        for law in plant.laws:
            if np.array_equal(law.shape[: len(rig.masses)], rig.shape(element)):
                law.shape[size] = -1.0
        return replace(altered, plant=plant)

    names = ("frame_mass_kg", "frame_stiffness_n_per_m", "frame_damping_n_s_per_m")
    places = (*together(rig, i), rig.body(element.a))
    return Hidden(
        "frame_compliance", places, "frame", add, lambda s: dict(zip(names, values(s), strict=True)), start=1e-3
    )


def _rocking(trial: Trial, rng: Rng) -> Hidden | None:
    rig = trial.rig
    body = int(np.argmax(rig.sensors[0].weights))
    touching = [i for i, e in enumerate(rig.elements) if body in (e.a, e.b) and e.stiffness]
    i = int(rng.choice(touching))
    inertia = rig.masses[body].true * float(rng.uniform(0.2, 0.6))
    omega, ratio = _modes(trial)[1] * float(rng.uniform(1.2, 2.2)), float(rng.uniform(0.005, 0.05))

    def add(altered: Altered, s: float) -> Altered:
        size = altered.plant.masses.size
        branch = Branch(wider(np.zeros(0), altered.plant), inertia * omega**2, 2 * ratio * omega * inertia)
        branch.shape[size] = 1.0
        plant = altered.plant.with_body(inertia, branch)
        plant.branches[i].shape[size] = s * (1.0 if rig.elements[i].a == body else -1.0)
        sees = {}
        for number, sign in ((0, 1.0), (1, -1.0)):
            sees[number] = wider(np.array(rig.sensors[number].weights), altered.plant)
            sees[number][size] = sign
        return replace(altered, plant=plant, sees={**altered.sees, **sees})

    return Hidden("rocking", (rig.body(body), *together(rig, i)), "body", add)


def _relaxation(trial: Trial, rng: Rng) -> Hidden | None:
    rig = trial.rig
    i = chosen(rig, ("spring", "joint", "contact"), rng)
    if i is None:
        return None
    element = rig.elements[i]
    stiffness = element.stiffness.true if element.stiffness else 0.0
    low, high = _modes(trial)
    time = float(np.exp(rng.uniform(np.log(0.3 / high), np.log(5.0 / low))))

    def add(altered: Altered, s: float) -> Altered:
        shape = wider(rig.shape(element), altered.plant)[:-1]
        plant = altered.plant
        return replace(altered, plant=replace(plant, relaxing=(*plant.relaxing, Relaxing(shape, s * stiffness, time))))

    def told(s: float) -> dict[str, float]:
        return {"relaxing_stiffness_n_per_m": s * stiffness, "relaxation_time_s": time}

    return Hidden("relaxation", together(rig, i), element.section, add, told, most=2.0)


def _series_to_ground(trial: Trial, rng: Rng) -> Hidden | None:
    """A spring in series with a damper from a body that nothing else connects with the ground."""
    rig = trial.rig
    held = {e.a for e in rig.elements if e.b == GROUND}
    free = [i for i in range(len(rig.masses)) if i not in held]
    body = int(rng.choice(free)) if free else 0
    low, high = _modes(trial)
    stiffness = rig.masses[body].true * low * high
    time = float(np.exp(rng.uniform(np.log(0.5 / high), np.log(2.0 / low))))

    def add(altered: Altered, s: float) -> Altered:
        shape = wider(unit(len(rig.masses), body), altered.plant)[:-1]
        plant = altered.plant
        return replace(altered, plant=replace(plant, relaxing=(*plant.relaxing, Relaxing(shape, s * stiffness, time))))

    return Hidden("series_damper_to_ground", (rig.body(body),), "body", add, most=2.0) if free else None


def _loss(trial: Trial, rng: Rng) -> Hidden | None:
    """Damping of springs that are said to have none."""
    rig = trial.rig
    i = chosen(rig, ("spring",), rng, lambda e: e.damping is None)
    if i is None:
        return None
    element = rig.elements[i]
    unit_loss = (element.stiffness.true if element.stiffness else 0.0) / _modes(trial)[0]

    def add(altered: Altered, s: float) -> Altered:
        branch = Branch(wider(rig.shape(element), altered.plant)[:-1], 0.0, s * unit_loss)
        return replace(altered, plant=replace(altered.plant, branches=(*altered.plant.branches, branch)))

    told = {"c_n_s_per_m": unit_loss}
    return Hidden(
        "tube_spring_damping",
        together(rig, i),
        "spring",
        add,
        lambda s: {name: s * value for name, value in told.items()},
        start=1e-3,
        most=0.3,
    )


def _second_impact(trial: Trial, rng: Rng) -> Hidden:
    rig = trial.rig
    bodies = len(rig.masses)
    start = trial.records[0].start[bodies:]
    tapped = int(np.argmax(np.abs(start)))
    sample = int(rng.uniform(0.02, 0.25) * trial.records[0].count)

    def add(altered: Altered, s: float) -> Altered:
        return replace(altered, kick=(sample, np.append(np.zeros(bodies), s * unit(bodies, tapped))))

    # over the impulse that would have given the body the energy that the recordings begin with
    begun = trial.records[0].start
    first = np.sqrt(2 * _energy(trial, begun) / rig.masses[tapped].true) / float(np.max(np.abs(start)))
    places = (rig.body(tapped), "impactor")
    return Hidden("double_hit", places, "input", add, lambda s: {"second_impulse_fraction": s / float(first)})


def _knock(trial: Trial, rng: Rng) -> Hidden:
    """Somebody bumps into a body of a driven rig, once in one of the recordings."""
    rig = trial.rig
    bodies, number = len(rig.masses), int(rng.integers(len(trial.records)))
    struck, sample = int(rng.integers(bodies)), int(rng.uniform(0.05, 0.95) * trial.records[number].count)
    linear = rig.plant(rig.true_values())
    u = trial.records[number].size * trial.records[number].drive.steps(1)
    fastest = float(np.abs(linear.motion(trial.records[number].start, u, 1 / rig.rate)[0][1]).max())

    def add(altered: Altered, s: float) -> Altered:
        return replace(altered, knock=(number, sample, np.append(np.zeros(bodies), s * fastest * unit(bodies, struck))))

    impulse = rig.masses[struck].true * fastest
    return Hidden("knock", (rig.body(struck),), "body", add, lambda s: {"knock_impulse_n_s": s * impulse})


def _energy(trial: Trial, state: Array) -> float:
    """Energy of the linear rig (J) with displacements and velocities (2 bodies,)."""
    rig = trial.rig
    x, v = np.split(state, 2)
    stored = [e.stiffness.true * float(rig.shape(e) @ x) ** 2 for e in rig.elements if e.stiffness]
    return 0.5 * (float(np.sum([m.true for m in rig.masses] * v**2)) + sum(stored))


ADDITIONS = (
    Effect("attached_mass", Wants(), _attached),
    Effect("frame_compliance", Wants(), _frame),
    Effect("rocking", Wants(sensors=2, twins=True), _rocking),
    Effect("relaxation", Wants(), _relaxation),
    Effect("tube_spring_damping", Wants(undamped=True), _loss),
    Effect("double_hit", Wants(excited="free"), _second_impact),
    Effect("knock", Wants(excited="forced"), _knock),
)
UNLISTED_ADDITIONS = (Effect("series_damper_to_ground", Wants(), _series_to_ground),)
