"""What a check of the wiring by one tap means, in sentences: what is wrong, and what to do about it."""

from __future__ import annotations

import math
from collections.abc import Iterator

from daq.channel_relation import ChannelRelation
from daq.settings import Quality
from daq.wiring_check import WiringCheck
from mesotap.session.self_test import Verdict
from rig.settings import Channel, Wiring

NAMES = ("A", "B")
CERTAIN_CHI2 = 25.0  # five standard deviations for one polarity against the other
COVERAGE = 2.0  # standard uncertainties of the sensitivities within which the gains may differ
LEAST_CORRELATION = 0.5  # under it the channels saw different motions, and have no common sign
LARGEST_DELAY_S = 20e-6  # by which the mean of A and B loses 1 % at 2.2 kHz, the paper's highest contact resonance
LEAST_SIDE = 0.1  # by which the first flanks have to differ for one side to have seen more
HUM_SHARE = 0.1  # of the noise that a tap may have: a line below it changes no verdict


def wiring_verdicts(
    found: WiringCheck, wiring: Wiring, quality: Quality, sample_rate_hz: float, side: int = 0
) -> list[Verdict]:
    """Return the verdicts on a check, those that were passed too.

    Parameters
    ----------
    found
        What was measured.
    wiring, quality
        Sections ``rig.wiring`` and ``daq.quality`` of the configuration.
    sample_rate_hz
        Sampling rate, Hz.
    side
        Where the lower mass was tapped; see `mesotap.session.view_order.SIDES`.
    """
    verdicts = [_channels(found, wiring), _saturation(found), _strength(found, quality)]
    if found.relation is not None:
        verdicts.append(_polarity(found, found.relation, wiring))
        if side:
            verdicts.append(_side(found, side))  # a mass that rotates tells nothing of gain and delay
        else:
            alike = _rotation(found, quality)
            verdicts.append(alike)
            if alike.passed:
                verdicts += [_gain(found.relation, wiring, quality), _delay(found.relation, sample_rate_hz)]
    return [*verdicts, *_noise(found, wiring, quality)]


def _channels(found: WiringCheck, wiring: Wiring) -> Verdict:
    said = f"A peaks at {found.peak_m_s2[0]:.3g}, B at {found.peak_m_s2[1]:.3g} m/s2"
    dead = [i for i in (0, 1) if not found.alive[i]]
    if not dead:
        return Verdict("channels", True, f"both see the tap: {said}")
    which = " and ".join(NAMES[i] for i in dead)
    keys = " and ".join(
        f"rig.wiring.accelerometer_{NAMES[i].lower()}.input ({_channel(wiring, i).input})" for i in dead
    )
    nothing = " (not even noise)" if any(found.noise_m_s2[i] == 0.0 for i in dead) else ""
    sees = "does" if len(dead) == 1 else "do"
    return Verdict(
        "channels",
        False,
        f"{which} {sees} not see the tap{nothing}: {said}; check sensor, cable and conditioner, and {keys}",
    )


def _saturation(found: WiringCheck) -> Verdict:
    clipped = [NAMES[i] for i in (0, 1) if found.clipped[i]]
    if not clipped:
        return Verdict("saturation", True, "neither channel is clipped")
    return Verdict(
        "saturation",
        False,
        f"{' and '.join(clipped)} clipped: tap more gently; if a gentle tap clips too, take a larger "
        "rig.wiring.input_range_v or a smaller gain",
    )


def _strength(found: WiringCheck, quality: Quality) -> Verdict:
    ratios = [p / n if n > 0 else math.inf for p, n in zip(found.peak_m_s2, found.noise_m_s2, strict=True)]
    best = max(ratios)
    if best >= quality.smallest_signal_to_noise:
        return Verdict("strength", True, f"the tap is {best:.0f} times the noise")
    return Verdict(
        "strength",
        False,
        f"the tap is only {best:.0f} times the noise (at least {quality.smallest_signal_to_noise:g}): tap harder",
    )


def _polarity(found: WiringCheck, relation: ChannelRelation, wiring: Wiring) -> Verdict:
    said = f"correlation {relation.correlation:.4f} ({relation.correlation_low:.4f} to {relation.correlation_high:.4f})"
    if relation.sign_chi2 < CERTAIN_CHI2 or abs(relation.correlation) < LEAST_CORRELATION:
        return Verdict(
            "polarity", False, f"cannot be told from this tap, {said}: tap harder, on the middle of the mass"
        )
    down = [i for i in (0, 1) if found.first_swing_m_s2[i] < 0]
    if relation.correlation > 0 and not down:
        return Verdict("polarity", True, f"A and B agree: {said}")
    if relation.correlation > 0 and len(down) == 2:
        opposite = wiring.accelerometer_a.polarity != wiring.accelerometer_b.polarity
        cables = "their cables are on each other's input (one of them is mounted upside down), or " if opposite else ""
        return Verdict(
            "polarity",
            False,
            f"A and B agree, {said}, but both see a tap from above upside down: {cables}both have the wrong "
            f"rig.wiring polarity; if you tapped from below, tap from above",
        )
    if relation.correlation > 0:
        return Verdict("polarity", True, f"A and B agree: {said}; the first swing does not tell which way round")
    i = down[0] if len(down) == 1 else 1
    name, channel = NAMES[i], _channel(wiring, i)
    return Verdict(
        "polarity",
        False,
        f"{name} sees the tap upside down, {said}: turn the sensor over, or set "
        f"rig.wiring.accelerometer_{name.lower()}.polarity to {-channel.polarity}",
    )


def _gain(relation: ChannelRelation, wiring: Wiring, quality: Quality) -> Verdict:
    ratio, half = abs(relation.gain), relation.gain_half
    said = f"B reads {ratio:.4g} ± {half:.2g} times what A reads"
    known = COVERAGE / 100 * math.hypot(*(_channel(wiring, i).sensitivity_uncertainty_percent for i in (0, 1)))
    if abs(ratio - 1) <= known + half:
        return Verdict("gain", True, f"{said}, as well as their sensitivities are known")
    keys = "sensitivity_mv_per_g and gain of both in rig.wiring, and the conditioner's switches"
    refused = abs(ratio - 1) / (ratio + 1) > quality.largest_rotation
    if refused:
        return Verdict("gain", False, f"{said}: with that no tap of a session would be used; check {keys}")
    return Verdict(
        "gain",
        False,
        f"{said}, which their sensitivities ({100 * known:.1f} %) do not explain: tap once more in the middle; if it "
        f"stays, check {keys}",
    )


def _delay(relation: ChannelRelation, sample_rate_hz: float) -> Verdict:
    delay, half = relation.delay_samples, relation.delay_half
    later = "B" if delay > 0 else "A"
    said = f"{abs(delay):.2f} ± {half:.2g} samples between A and B"
    if abs(delay) - half <= LARGEST_DELAY_S * sample_rate_hz:
        return Verdict("delay", True, said)
    return Verdict(
        "delay",
        False,
        f"{later} comes later, {said}: see that the recorder samples both at once and that both pass the same filter",
    )


def _rotation(found: WiringCheck, quality: Quality) -> Verdict:
    said = f"A and B differ by {found.rotation:.0%} of their sum in the first {quality.rotation_window_ms:g} ms"
    if found.rotation <= quality.largest_rotation:
        return Verdict("alike", True, said)
    return Verdict(
        "alike",
        False,
        f"{said} (limit {quality.largest_rotation:.0%}), whatever their gains and delay: tap in the middle, and "
        "see that both sit firmly on the lower mass",
    )


def _side(found: WiringCheck, side: int) -> Verdict:
    first = [abs(flank) for flank in found.onset_m_s2]
    more = math.log(first[0] / first[1]) if min(first) > 0 else 0.0
    near, far = NAMES if side > 0 else NAMES[::-1]
    said = f"on the first flank A {first[0]:.3g}, B {first[1]:.3g} m/s2"
    if abs(more) < math.log1p(LEAST_SIDE):
        return Verdict("sides", None, f"{said}, alike: tap nearer to {near} to see whether the cables are swapped")
    if (more > 0) == (side > 0):
        return Verdict("sides", True, f"{near}, beside which you tapped, saw the more; {said}")
    return Verdict(
        "sides",
        False,
        f"you tapped beside {near}, and {far} saw the more; {said}: the cables are swapped, exchange them at the "
        "recorder, or exchange accelerometer_a and accelerometer_b in rig.wiring",
    )


def _noise(found: WiringCheck, wiring: Wiring, quality: Quality) -> Iterator[Verdict]:
    """Noise and hum before the tap."""
    limit = quality.largest_noise_m_s2
    said = f"A {found.noise_m_s2[0]:.2g}, B {found.noise_m_s2[1]:.2g} m/s2 rms before the tap"
    loud = [NAMES[i] for i in (0, 1) if found.noise_m_s2[i] > limit]
    if loud:
        which = " and ".join(loud)
        yield Verdict(
            "noise", False, f"{said}: {which} over {limit:g}: wait until the bench is quiet, check cables and grounding"
        )
    else:
        yield Verdict("noise", True, f"{said}, of {limit:g}")
    hums = [(NAMES[i], line) for i, line in enumerate(found.lines) if line is not None]
    loudest = max((line.rms_m_s2 for _, line in hums), default=0.0)
    if not hums:
        yield Verdict("hum", True, "no line of the mains stands out of the noise")
        return
    which = ", ".join(f"{name} {line.rms_m_s2:.2g} m/s2 rms at {line.mains_hz:.0f} Hz" for name, line in hums)
    if loudest <= HUM_SHARE * limit:
        yield Verdict("hum", True, f"of the mains: {which}, too little to matter")
    else:
        yield Verdict(
            "hum",
            False,
            f"of the mains: {which}: check the shield and its ground (one only), keep the cable away from the mains",
        )


def _channel(wiring: Wiring, i: int) -> Channel:
    return (wiring.accelerometer_a, wiring.accelerometer_b)[i]
