"""What is behind an answer about impacts: maps of the residual, the contact's force, the selection."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from markupsafe import Markup

from analysis.mismatch.account import FAR_OFF, far_off
from analysis.mismatch.answer import LOAD_SCALE
from analysis.mismatch.evidence.excess import by_impact, map_by_frequency, map_by_time, spectrum
from analysis.mismatch.evidence.reconstruction import law_along, reconstruct, stitched, telling_impacts
from analysis.mismatch.evidence.varying import contact_by_amplitude, contact_in_time
from analysis.mismatch.ring_downs.corrected import contact_at_rest
from analysis.mismatch.ring_downs.judge import ImpactJudge
from analysis.mismatch.ring_downs.problem import RingDownFit
from analysis.mismatch.selection import Selection
from analysis.results import SessionResults
from calibration.estimate import Estimate
from mesotap.answers.candidates import candidate_table, considered
from mesotap.answers.diagnosis_page import C_C, K_C, ZETA_2, Evidence, Picture, Table
from mesotap.answers.diagnosis_text import constant_words, words
from mesotap.answers.rounding import significant, with_uncertainty
from mesotap.report import figures
from sim_backend.arrangement import Parameter
from sim_backend.mechanisms.catalogue import catalogue
from sim_backend.mechanisms.kinds import Mechanism

METHOD = Markup(
    "All loads and impacts are fitted together by Eq. 9 with its own constants free within their uncertainties, {k} "
    "and <i>c</i><sub>c</sub> of each load, the state of both masses when each pulse has ended, the declared filter "
    "and the spectrum of the noise. Mechanisms are screened by score tests on what that leaves, the best fitted in "
    "full, further ones added as long as held-out impacts get better; what differs from impact to impact is fitted on "
    "these with the same freedom before and after. A name is given only where forces and channels of any shape would "
    "take away little more. Equation numbers refer to “Measurement and Modeling of Normal Contact Stiffness and "
    "Contact Damping at the Meso Scale”, doi 10.1115/1.1857920."
).format(k=K_C)


RingDownSelection = Selection[RingDownFit]


def evidence_of_impacts(
    selection: RingDownSelection, known: Mapping[str, tuple[Mechanism, ...]], results: SessionResults | None
) -> Evidence:
    """Return figures and tables of a selection.

    Parameters
    ----------
    known
        Mechanisms that took part, by id.
    results
        Of the session's linear analysis, for frequency and damping against amplitude; None to leave that out.
    """
    tester = selection.best.problem.is_tester
    return Evidence(
        where=_where(selection.baseline, results, tester),
        what=(_force(selection),) if tester else (),
        gained=_gained(selection),
        candidates=(candidate_table(selection, known),) if selection.steps else (),
        considered=considered(selection, known),
        constants=(*((_contact(selection),) if tester else ()), _constants(selection)),
        excluded=tuple(m for m in catalogue() if m not in known),
        method=METHOD,
    )


def _augmented(selection: RingDownSelection) -> RingDownFit | None:
    return selection.best if selection.best.terms else None


def law_name(fit: RingDownFit | None) -> str:
    """Name the mechanisms of a fit."""
    return "" if fit is None else " and ".join(words(t.mechanism.id) for t in fit.terms)


def _beside(selection: RingDownSelection) -> str:
    """Say what the better model has more than Eq. 9: what was left out, or the best that is not named."""
    if selection.chosen is not None or not selection.best.terms:
        return "with what was left out"
    return f"with {law_name(selection.best)} (not named)"


def _where(before: RingDownFit, results: SessionResults | None, tester: bool) -> tuple[Picture, ...]:
    drawn = [
        Picture(
            "excess",
            figures.excess_figure(map_by_frequency(before), map_by_time(before)),
            "Residual power over noise against load and frequency, and load and time",
            "Power of what the fit of Eq. 9 leaves, over the power of the noise: 1 is noise alone. Top: by load and "
            "frequency; bottom: by load and time after the pulse. Left: what both accelerometers see; right: in what "
            "they differ.",
        ),
        Picture(
            "excess-by-impact",
            figures.excess_by_impact_figure(by_impact(before)),
            "Residual beyond noise of each impact against its order and its strength",
            "By how much each impact's residual is more than noise, against (a) its place in the session and (b) its "
            "strength. Grey: 95 % of impacts that Eq. 9 explains. A trend in (a) is a contact that changes during the "
            "session, in (b) one that is not linear.",
        ),
    ]
    if tester:
        drawn.append(_varying(before))
    if results is not None and figures.shown_amplitudes(results):
        drawn.append(
            Picture(
                "amplitude",
                figures.amplitude_figure(results),
                "Frequency change and damping ratio of the contact mode against its amplitude along the ring-down",
                "The same without any model of the rig: (a) frequency and (b) damping ratio of the contact mode along "
                "the ring-down, against its amplitude, with 95 % intervals; time runs from right to left.",
            )
        )
    return tuple(drawn)


def _varying(before: RingDownFit) -> Picture:
    return Picture(
        "varying",
        figures.varying_figure(contact_in_time(before), contact_by_amplitude(before)),
        "Contact stiffness and damping let free in windows of time and amplitude",
        Markup(
            "{} (top, as change of the fitted one) and {} (bottom, over its critical value 2 √({} <i>m</i>), where "
            "<i>m</i> is the reduced mass) let free in windows of time (left) and of the "
            "contact's own dynamic force (right), with 95 % intervals. A linear contact is flat in all four; where "
            "a constant has to vary, the flaw is."
        ).format(K_C, C_C, K_C),
    )


def _force(selection: RingDownSelection) -> Picture:
    before, after = selection.baseline, _augmented(selection)
    unnamed = " (not named)" if selection.chosen is None and after is not None else ""
    numbers = telling_impacts(before, selection.best)
    columns = "Left: the strongest impact of the load that tells most; right: its weakest. " if len(numbers) > 1 else ""
    return Picture(
        "force",
        figures.force_figure([_picture(before, after, number) for number in numbers], law_name(after) + unnamed),
        "Contact force against deflection, reconstructed and by the laws",
        Markup(
            "The contact's force, read off the recordings without a law: <i>m</i><sub>2</sub> <i>a</i><sub>2</sub> + "
            "<i>k</i><sub>2</sub> <i>x</i><sub>2</sub> is the force, the upper mass's equation gives its own motion. "
            "{}Top: against deflection; bottom: what it is beyond Eq. 9's, as points and as means over bins of the "
            "deflection. Dashed, where it is in view: minus the load, at which the surfaces would part. The slow part "
            "of the deflection, which no accelerometer shows, is chosen so that swings of all sizes lie on one curve."
        ).format(columns),
    )


def _picture(before: RingDownFit, after: RingDownFit | None, number: int) -> figures.ForcePicture:
    segment = before.segments[number]
    stiffness = before.constants.at(segment.group)["kc"]
    motion = stitched(reconstruct(before, number, after), stiffness)
    frequency = float(np.abs(before.modes[segment.group].rig.poles).max()) / (2 * np.pi)
    augmented = None if after is None else law_along(after, segment, motion)
    return figures.ForcePicture(motion, law_along(before, segment, motion), augmented, stiffness, frequency)


def _gained(selection: RingDownSelection) -> tuple[Picture, ...]:
    before, after, later = selection.baseline, _augmented(selection), _beside(selection)
    spectra = Picture(
        "spectra",
        figures.residual_spectra_figure(spectrum(before), None if after is None else spectrum(after), later=later),
        "Residual spectra before and after, over the noise",
        "Spectra of the residuals over the noise, all fitted impacts together, smoothed over nine bins.",
    )
    judge = selection.judge
    if not isinstance(judge, ImpactJudge) or not judge.held_out:
        return (spectra,)
    held_out = None if after is None else judge.held_out_fit(after)
    kept = figures.held_out_figure(judge.held_out_fit(before), held_out, later)
    label = "Residual of each held-out impact before and after"
    caption = "Every held-out impact: rms of the whitened residual over that of the noise."
    return (Picture("held_out", kept, label, caption), spectra)


def _contact(selection: RingDownSelection) -> Table:
    after = _augmented(selection)
    before = contact_at_rest(selection.baseline)
    corrected = () if after is None else contact_at_rest(after)
    k, z = Markup("{} [MN/m]").format(K_C), Markup("{} [%]").format(ZETA_2)
    unnamed = "" if selection.chosen is not None else ", which is not named,"
    rows: list[tuple[str, ...]] = []
    for place, plain in enumerate(before):
        row = [f"{1e3 * plain.load_n:.1f}"]
        row += [with_uncertainty(c.stiffness, 1e-6) for c in (plain, *corrected[place : place + 1])]
        row += [with_uncertainty(c.damping_ratio, 100) for c in (plain, *corrected[place : place + 1])]
        rows.append(tuple(row))
    beside = (
        f", and with {law_name(after)}{unnamed} in the model, where they are those at zero amplitude" if after else ""
    )
    mean = ", of the mean of a load's impacts where these scatter" if selection.best.problem.scattered else ""
    caption = Markup(
        "{} and {} by Eq. 9{}; ± is half of the 95 % interval of the joint fit{}. Where a mass or the scale of "
        "the loads ends far from what was declared, it reaches to what masses as declared and loads as measured give."
    ).format(K_C, ZETA_2, beside, mean)
    found = ", corrected" if selection.chosen is not None else ", with it"
    models = (", Eq. 9", found) if after else (", Eq. 9",)
    return Table(caption, ("Load [mN]", *(q + m for q in (k, z) for m in models)), tuple(rows), ())


def _against_declared(value: float, declared: Parameter) -> Markup:
    """Write a fitted constant, marked where it is far from what was declared."""
    off = far_off({declared.name: value}, [declared]).get(declared.name)
    mark = "" if off is None else Markup(" <b>({} off)</b>").format(f"{off:.0f} uncertainties")
    return Markup("{}{}").format(significant(value, 5), mark)


def _constant_title(p: Parameter) -> Markup:
    if p.name == LOAD_SCALE:
        return Markup("{} [1]").format(constant_words(p.name))
    return Markup("<i>{}</i><sub>{}</sub> [{}]").format(p.name[0], p.name[1:], p.unit)


def _constants(selection: RingDownSelection) -> Table:
    """List the rig's declared constants with what the fits made of them."""
    fits = (selection.baseline, selection.best) if selection.best.terms else (selection.baseline,)
    values = [dict(zip(f.constants.names()[0], f.constants.rig.tolist(), strict=True)) for f in fits]
    rows = tuple(
        (
            _constant_title(p),
            with_uncertainty(Estimate(p.value, p.uncertainty)),
            *(_against_declared(v[p.name], p) for v in values),
        )
        for p in selection.best.problem.arrangement.parameters
        if p.name in values[0]
    )
    caption = (
        "What the fits had to change of the declared constants; a wrong value is not missing physics. One that ends "
        f"more than {FAR_OFF:g} uncertainties off is marked: it was declared wrongly or stands in for something."
    )
    return Table(caption, ("Constant", "Declared", *("Eq. 9", f"W{_beside(selection)[1:]}")[: len(fits)]), rows)
