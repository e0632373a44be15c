"""A diagnosis in words: the verdict as a sentence, and what a terminal shows."""

from __future__ import annotations

import numpy as np
from rich.console import Console

from analysis.mismatch.answer import (
    LOAD_CELL,
    LOAD_SCALE,
    TESTER,
    TESTER_SCALES,
    Answer,
    FittedRig,
    Interval,
    LawKind,
    Named,
    NextExperiment,
)
from analysis.mismatch.policy import POLICY
from analysis.mismatch.remainder import SEEN, p_words, place_words
from mesotap.answers.rounding import counted, significant, unit, with_ends
from mesotap.operator.tables import Table
from mesotap.operator.terminal import escape
from sim_backend.learned.curves import BEND

LEAST = 1e-4  # probability below which its digits say nothing
KINDS: dict[LawKind, str] = {
    "static": "a force of the deflection",
    "rate": "a force of the rate",
    "memory": "a force with a memory",
    "time": "a change with time",
    "load": "a force that goes with the load",
    "sensor": "a bent scale",
    "input": "a part of the excitation",
    "clock": "a clock",
    "dynamics": "a resonance",
}
"""What a learned law is called in a sentence."""
MOST_NAMED = 3  # constants in a sentence
HUNDREDTH = 0.005  # probability from which on two decimals show something
FAR_BEYOND = 3.0
"""Times the noise: larger errors on held-out impacts leave the name in doubt. Chosen by hand: right names had at most
1.014 times the error of a fit that knows (docs/proof), Hertz' law named for a rough surface 28 (one session)."""

# share of what the linear rig misses of a recording, from which on a name that leaves it is in doubt: what is read from
# errors as noise may be less than it is
CURVE_POINTS = 9  # of a learned curve that are told
ROUNDING = 1e-9  # of its largest deflection, that is none
MATTERS = 0.01
SMALL = 0.1  # share of what the linear rig misses, up to which a remainder is called small


def words(mechanism_id: str) -> str:
    """Return a mechanism's id as words."""
    return mechanism_id.replace("_", " ")


def constant_words(name: str) -> str:
    """Return how a constant of the rig is called in a sentence."""
    return "the loads" if name == LOAD_SCALE else name


def linear_rig(answer: Answer) -> str:
    """Return how the linear rig is called in a sentence."""
    return "Eq. 9" if answer.rig == TESTER else "the rig as described"


def what_was_recorded(answer: Answer) -> str:
    """Return how many recordings there are, and at which loads."""
    loads = sorted(answer.loads_n.values())
    if not loads:
        return "these recordings"
    impacts = counted(answer.fit.segments, "impact")
    if len(loads) == 1:
        return f"{impacts} at {1e3 * loads[0]:.0f} mN"
    return f"{impacts} at {len(loads)} loads from {1e3 * loads[0]:.0f} to {1e3 * loads[-1]:.0f} mN"


def verdict_sentence(answer: Answer) -> str:
    """Say the answer in a sentence; where something remains beyond what is named, in two; then what was set aside."""
    count = sum(bool(one.group) for one in answer.set_aside)  # samples of recordings have no group
    if answer.worse_than_zero:
        return answer.worse_than_zero if answer.far_off else f"{answer.worse_than_zero} {_verdict(answer)}"
    if not count:
        samples = " Samples that cannot be the rig's own motion are set aside." if answer.set_aside else ""
        return f"{_verdict(answer)}{samples}"
    what = "One tap shows what no other does and is" if count == 1 else f"{count} taps show what no other does and are"
    return f"{_verdict(answer)} {what} set aside."


def _verdict(answer: Answer) -> str:
    linear, recorded, chance = linear_rig(answer), what_was_recorded(answer), p_words(answer.p_value)
    begin = linear[0].upper() + linear[1:]
    if answer.otherwise:
        return (
            f"{begin} does not explain {recorded} ({chance}). It leaves nothing once the rig file {answer.otherwise}."
        )
    if answer.far_off:
        return (
            f"{begin} misses most of the motion: check its stiffness and mass, their units and the channels, or say "
            "'unknown' for unknown constants."
        )
    if answer.verdict == "consistent":
        cells = "; recordings and load cell" if _with_load_cell(answer) else ""
        return (
            f"{begin} with its constants refitted explains {recorded}: nothing is left beyond noise ({chance}{cells})."
        )
    if answer.verdict == "unexplained" or not answer.mechanisms:
        where = "" if answer.location is None else f"; it lies {place_words(answer.location)}"
        return f"{begin} does not explain {recorded} ({chance}), and no mechanism listed does{where}."
    if all(m.where == LOAD_CELL for m in answer.mechanisms):
        return (
            f"{begin} with its constants refitted explains {recorded}, but the load cell drifted between its "
            f"calibrations ({chance}): the loads are in doubt."
        )
    names = " and ".join(_name(m, answer.rig) for m in answer.mechanisms)
    sure = min(m.probability for m in answer.mechanisms)
    said = f"{begin} does not explain {recorded} ({chance}); it leaves out {names}, with a probability of {sure:.2f}."
    return " ".join([said, _what_remains(answer), *_constants_in_doubt(answer)])


def _with_load_cell(answer: Answer) -> bool:
    """Whether the p-value of a verdict that nothing is missing tests the drift of the load cell, too."""
    return answer.verdict == "consistent" and answer.p_value != answer.remainder.p_value


def left_over(answer: Answer) -> str:
    """Say what is left over; where the verdict has another p-value, of what this one is."""
    if not _with_load_cell(answer) or answer.remainder.where is not None:
        return answer.remainder.statement
    chance = p_words(answer.remainder.p_value)
    return f"Nothing beyond noise is left in the recordings by themselves, without the load cell ({chance})."


def _constants_in_doubt(answer: Answer) -> list[str]:
    """Say which declared constants the fit moved far, as what is read beside them is then wrong, too."""
    off = {} if answer.fitted is None else answer.fitted.off
    if not off:
        return []
    most = sorted(off, key=lambda k: -off[k])[:MOST_NAMED]
    names = " and ".join(", ".join(f"{constant_words(k)} by {off[k]:.0f}" for k in most).rsplit(", ", 1))
    others = f" (and {len(off) - len(most)} more)" if len(off) > len(most) else ""
    said = (
        f"It moves {names} declared uncertainties{others}: either they were declared wrongly, or they make up "
        "for a law that is not quite right"
    )
    if answer.rig == TESTER and not TESTER_SCALES.isdisjoint(off):
        return [f"{said}. The intervals of k_c and c_c reach to what masses as declared and loads as measured give."]
    stiffness = "k_c and c_c" if answer.rig == TESTER else "the other constants"
    return [f"{said}, and {stiffness} may then be wrong by far more than their intervals."]


def _name(m: Named, rig: str) -> str:
    if not m.learned:
        return words(m.id) if rig == TESTER or not m.element else f"{words(m.id)} ({m.element})"
    what = "a law" if m.law is None else KINDS[m.law.kind]
    return f"{what} that no mechanism listed has, learned from these recordings ({m.element or m.where})"


def _what_remains(answer: Answer) -> str:
    left = answer.remainder
    with_it = "With it" if len(answer.mechanisms) == 1 else "With them"
    if left.where is None:
        return f"{with_it} nothing is left beyond noise ({p_words(left.p_value)})."
    if left.chi_squared < SEEN:
        return (
            f"That explains all that a force or channel of any shape could; something else remains "
            f"{place_words(left.where)} ({p_words(left.p_value)})."
        )
    far = _over_noise(answer)
    doubted = far > 0 and (bool(answer.loads_n) or left.share > MATTERS)
    size = "something small remains" if left.share < SMALL and not doubted else "something remains"
    said = (
        f"That explains {_percent(1 - left.share)} of what is missing; {size} {place_words(left.where)} "
        f"({p_words(left.p_value)})."
    )
    if not far:
        return said
    doubt = "the right name may be another one" if doubted else "more may be at work, which the intervals do not count"
    return f"{said} What was held out is still missed by {far:.0f} times the noise: {doubt}."


def _over_noise(answer: Answer) -> float:
    """Return the held-out error with what is named, over the noise, where it is far beyond; 0 elsewhere."""
    after, noise = answer.fit.heldout_rms_after, answer.fit.noise_rms
    beyond = FAR_BEYOND if answer.loads_n else POLICY.far_over_noise
    return after / noise if after is not None and after > beyond * noise > 0 else 0.0


def _percent(share: float) -> str:
    """Write a share near one so that what it lacks shows."""
    lacking = 100 * (1 - share)
    decimals = 0 if lacking >= 1 else 1 if lacking >= 0.1 else 2
    return f"{min(100 * share, 99.99):.{decimals}f} %"


def probability_words(probability: float) -> str:
    """Write a probability; one that is hardly any without its digits."""
    return f"{probability:.2g}" if probability >= LEAST else f"< {LEAST:g}"


def print_answer(answer: Answer, console: Console) -> None:
    """Say the answer to a person."""
    console.print(f"[bold]{escape(verdict_sentence(answer))}[/bold]")
    for one in answer.set_aside:
        console.print(f"  set aside: {escape(one.statement)}")
    for m in answer.mechanisms:
        _print_mechanism(m, console)
    if answer.location is not None:
        element = answer.location.element
        which = f": {element}" if element not in (None, answer.location.component) else ""
        console.print(f"  where: {escape(answer.location.component + which)}; {escape(answer.location.why)}")
    if answer.verdict in ("missing_physics", "new_physics"):
        console.print(f"  left over: {escape(answer.remainder.statement)}")
        all_there_is = answer.complete_probability
        shown = f"{all_there_is:.2f}" if all_there_is >= HUNDREDTH else probability_words(all_there_is)
        console.print(f"  that this is all there is: {shown}")
    _print_held_out(answer, console)
    for said in () if answer.fitted is None else same_shown_words(answer.fitted, bool(answer.mechanisms)):
        console.print(f"  {escape(said)}")
    if answer.rivals:
        console.print(_rivals(answer))
        if said := unlisted_words(answer):
            console.print(f"  {said}")
    else:
        console.print(f"  {no_rival(answer)}")
    if answer.upper_limits:
        console.print(_limits(answer))
    then = answer.next_experiment
    if then is not None:
        console.print(f"  next: {escape(next_words(answer, then))} {escape(then.why)}")


def same_shown_words(fitted: FittedRig, named: bool) -> list[str]:
    """Say with which other constants every channel shows the same, and that what is ``named`` may differ with them."""
    found = []
    for other in fitted.also:
        units = {name: _in(fitted.constants[name].unit) for name in other}
        listed = ", ".join(f"{name} {significant(value, 5)}{units[name]}" for name, value in other.items())
        then = "; what is named may be of another size with these" if named else ""
        found.append(
            f"Every channel shows the same with {listed}: these recordings do not tell which of both it is{then}."
        )
    return found


def next_words(answer: Answer, then: NextExperiment) -> str:
    """Say in a sentence what to record next, and what that tells apart."""
    load = "" if then.load_n is None else f" at {1e3 * then.load_n:.0f} mN"
    ratio, what = then.peak_force_ratio, "record further impacts" if answer.loads_n else "make another recording"
    if ratio is not None:
        what = f"tap with {ratio:.2f} of the load" if answer.loads_n else f"record it {ratio:g} times as strong"
    first, second = map(words, then.separates)
    return f"{what}{load} to tell {first} from {second}."


def _print_mechanism(m: Named, console: Console) -> None:
    others = ", ".join(m.indistinguishable_from)
    alike = f"; these data cannot tell it from {others}" if others else ""
    console.print(f"  {escape(m.id)} ({escape(m.place)}, probability {m.probability:.2f}{escape(alike)})")
    console.print(f"    {escape(m.statement)}")
    for formula in () if m.law is None else m.law.formulas:
        console.print(f"    {escape(formula.text)}  (evidence {formula.evidence:+.1f} over a force of any shape)")
    for line in curve_words(m):
        console.print(f"    {escape(line)}")
    for name, v in told_parameters(m).items():
        console.print(f"    {escape(name)} = {with_ends(v.value, v.low, v.high)} {escape(unit(v.unit))}".rstrip())


def told_parameters(m: Named) -> dict[str, Interval]:
    """Return the parameters that a reader is told: those of a law without a formula say less than its curve."""
    curve = m.law is not None and any(name.startswith(BEND) for name in m.parameters)
    return {} if curve else dict(m.parameters)


def curve_words(m: Named) -> list[str]:
    """Return some points of a learned curve, with the ends of their 95 % intervals; none of what has a formula."""
    table = None if m.law is None or told_parameters(m) else m.law.table
    if table is None:
        return []
    x, *others = table.axes.values()
    at = [-1] * len(others)  # of a surface, along its end: the largest rate
    names = [axis.removesuffix("_m_per_s").removesuffix("_m") for axis in table.axes]
    force_unit = next(v.unit for v in m.parameters.values())
    length = {"deflection": " m", "rate": " m/s"} if force_unit == "N" else {}
    beside = "" if not others else f" at the largest {names[1]}"
    found = []
    x = np.where(np.abs(x) < ROUNDING * np.abs(x).max(), 0.0, x)
    for i in np.unique(np.linspace(0, len(x) - 1, CURVE_POINTS).round().astype(int)):
        force, low, high = (float(rows[(i, *at)]) for rows in (table.force_n, table.low, table.high))
        where = f"{names[0]} {significant(float(x[i]), 4)}{length.get(names[0], '')}{beside}"
        found.append(f"{where}: force {with_ends(force, low, high)} {unit(force_unit)}")
    return found


def _in(name: str) -> str:
    """Return a unit to stand behind a number; nothing where none is declared."""
    return f" {escape(unit(name))}" if name else ""


def _print_held_out(answer: Answer, console: Console) -> None:
    fit, of = answer.fit, _in(answer.fit.unit)
    after = "" if fit.heldout_rms_after is None else f", with what was left out {fit.heldout_rms_after:.5g}"
    console.print(
        f"  {fit.heldout_segments} held-out segments: rms {fit.heldout_rms_before:.5g}{of} by "
        f"{linear_rig(answer)} with its constants refitted{after}; noise {fit.noise_rms:.5g}"
    )
    for c in fit.channels:
        then = "" if c.heldout_rms_after is None else f", then {c.heldout_rms_after:.4g}"
        console.print(
            f"    {escape(c.channel)}: {c.heldout_rms_before:.4g}{then}{_in(c.unit)}; "
            f"noise {c.noise_rms:.4g}; what cannot be predicted is {c.heldout_over_noise:.3g} times as large as noise"
        )
    for name, (before, later) in fit.stretches.items():
        then = "" if later is None else f", then {later:.4g}"
        console.print(f"    {escape(name)}: {before:.4g}{then}{of}")
    if fit.steady_error is not None:
        before, later = fit.steady_error
        then = "" if later is None else f", then {100 * later:.3g} %"
        console.print(f"  steady responses held out: force off by {100 * before:.3g} %{then}")


def rivals_are(answer: Answer) -> str:
    """Say what the rivals are, which depends on what is named."""
    if answer.verdict == "unexplained":
        return "The best candidates, none of which is named"
    return "What comes nearest to being seen" if answer.verdict == "consistent" else "What else it could be"


def rival_probability(answer: Answer) -> str:
    """Say what the probability of a rival is of, which depends on what is named."""
    if answer.verdict == "consistent":
        return (
            "Probability: that this is missing all the same. Together the mechanisms have at most what the p-value of "
            "the overall test leaves; each has a share by what its score test takes away."
        )
    if answer.verdict == "unexplained":
        return "Probability: that this is at work and nothing else is beside it."
    said = (
        "Probability: that this is at work instead of what is named, where the other listed mechanisms, a force "
        "without a name and causes that are not listed are weighed too."
    )
    return f"{said} {unlisted_words(answer)}".rstrip()


def unlisted_words(answer: Answer) -> str:
    """Say which probability is left for what is not listed, where a mechanism by itself is named and that is much."""
    if answer.verdict != "missing_physics" or len(answer.mechanisms) != 1:
        return ""
    rest = 1 - answer.mechanisms[0].probability - sum(r.probability for r in answer.rivals)
    return "" if rest < HUNDREDTH else f"The rest of the probability, {rest:.2f}, is for causes that are not listed."


def no_rival(answer: Answer) -> str:
    """Say why there is no runner-up."""
    if answer.far_off:
        return "No runner-up: where the description is far off, what mechanisms take away says nothing of them."
    return "No runner-up: no other mechanism that took part takes away more of the residual than chance would."


def _rivals(answer: Answer) -> Table:
    table = Table(title=rivals_are(answer))
    table.add_column("instead")
    table.add_column("probability", justify="right")
    table.add_column(f"held-out rms, {escape(unit(answer.fit.unit) or '1')}", justify="right")
    table.add_column("why")
    for r in answer.rivals:
        table.add_row(
            " and ".join(r.ids), probability_words(r.probability), significant(r.heldout_rms, 4), escape(r.why)
        )
    return table


def _limits(answer: Answer) -> Table:
    table = Table(title="Upper limits of what is not named, 95 %")
    table.add_column("mechanism")
    table.add_column("parameter")
    table.add_column("at most", justify="right")
    for u in answer.upper_limits:
        table.add_row(u.id, u.parameter, f"{significant(u.value, 2)} {escape(unit(u.unit))}".rstrip())
    return table
