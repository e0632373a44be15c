"""The beginning of recordings, which is fitted before all of them: it tells early what leads nowhere."""

from __future__ import annotations

from analysis.mismatch.least_squares import Race, Stopping, minimise
from analysis.mismatch.recordings.model import Point, SimulationModel

STAGES = (0.05, 0.15, 0.4)  # of recordings: their phase is followed before all of them is fitted
TELLING = STAGES[1]  # at which a mechanism explains more than what stands without it, or is followed no further
FOLLOWED = 0.98  # of what is left there without it: laws that leave more end where they began (decision 185)
AS_NOISE = 16.0  # times the noise, up to which the objective to beat is that of a fit that leaves noise alone
FAR = 4.0  # times as much as that leaves of the beginning, from which a fit is not made of all (rigs of decision 189)


def leads_nowhere(
    model: SimulationModel, start: Point, to_beat: float, noise: float, stop: tuple[Stopping, Race]
) -> bool:
    """Whether a fit to the beginning leaves far more of it than noise, where what it competes with leaves noise alone.

    A mechanism that is at work leaves noise of any part. One that sets in later leaves noise of the beginning, too.

    Parameters
    ----------
    model, start
        Of all that is fitted, and where a fit would begin.
    to_beat
        Objective that such a fit has to reach.
    noise
        Mean square of residuals that are noise.
    """
    samples = model.evaluate(start).samples
    if to_beat > AS_NOISE * noise * samples:
        return False
    beginning = SimulationModel(model.simulation, start.own, model.parts, TELLING, rough=True)
    found, _ = minimise(beginning, beginning.evaluate(start), *stop)
    return found.objective > FAR * to_beat * found.samples / samples
