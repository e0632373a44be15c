"""An answer made by hand, with everything in it that an answer can hold."""

from __future__ import annotations

import numpy as np

from analysis.mismatch.answer import (
    TESTER,
    Answer,
    AtAmplitude,
    ContactAtRest,
    FitSummary,
    FittedRig,
    Formula,
    Interval,
    Law,
    LawTable,
    Location,
    Named,
    NextExperiment,
    RecordingFile,
    Remainder,
    Rival,
    UpperLimit,
)
from calibration.estimate import Estimate

HERE = Location(
    "lower mass", None, ("A", "B"), (2e-4, 6.1e-3), (4000.0, 4200.0), ("104 mN",), "It is more than noise there."
)
NAMED = Named(
    "hunt_crossley_damping",
    0.98,
    "contact",
    "Damping grows with approach.",
    {"damping_growth_per_relative_approach": Interval(1.4, 1.3, 1.5, "1")},
    ("squeeze_film",),
    element="contact",
)
LAW = Law(
    "static",
    "odd",
    True,
    {"deflection": Interval(3.0, 2.9, 3.1, "1"), "rate": None},
    (Formula("k3 * d**3", {"k3": Interval(1e15, 9e14, 1.1e15, "N/m3")}, -1.2),),
    {"deflection": (-1e-6, 1e-6)},
    LawTable({"deflection_m": np.linspace(-1e-6, 1e-6, 3)}, np.zeros(3), -np.ones(3), np.ones(3)),
)
LEARNED = Named(
    "law_in_the_contact", 0.9, "contact", "The contact stiffens.", {}, (), element="contact", learned=True, law=LAW
)
ANSWER = Answer(
    recordings=(RecordingFile("session.h5", "0" * 64),),
    rig=TESTER,
    verdict="missing_physics",
    p_value=1e-5,
    mechanisms=(NAMED,),
    complete_probability=0.8,
    remainder=Remainder(0.0, 3.0, 0.4, None, "Nothing beyond noise is left (p = 0.4)."),
    upper_limits=(UpperLimit("micro_slip", "slip_stiffness_share", 0.01, "1", 0.95),),
    rivals=(Rival(("squeeze_film",), 0.01, 0.0131, "It has less evidence."),),
    location=HERE,
    fit=FitSummary("m/s2", 0.01, 0.02, 0.011, 12, 48, 2, {"last": (0.02, None)}, (0.1, 0.05)),
    next_experiment=NextExperiment(0.104, 0.5, ("a", "b"), "They differ most there.", ("load", "tap")),
    loads_n={"104 mN": 0.1042, "250 mN": 0.2504},
    fitted=FittedRig(
        {"m1": Interval(0.107, 0.1069, 0.1071, "kg")},
        (ContactAtRest(0.1042, Estimate(4e6, 1e3), Estimate(20.0, 0.1), Estimate(0.01, 1e-4)),),
    ),
    decay=(AtAmplitude(0.1, 1.0, 80.0, 0.002),),
)
