"""Contact stiffness and damping from contact resonance: the tester's application, and a small face for programs.

``import mesotap`` gives the functions and classes of `mesotap.api`; each is imported when it is first used.

Examples
--------
>>> import mesotap
>>> session = mesotap.simulate(load_mn=500.0, seed=1)
>>> results = mesotap.identify(session)
>>> round(results.loads[0].f2_hz.value)
1904
"""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any

__version__ = "0.1.0"

# numba marks its messages with colours, where colorama is installed, and wraps sys.stdout anew for each of thousands
os.environ.setdefault("NUMBA_DISABLE_ERROR_MESSAGE_HIGHLIGHTING", "1")

if TYPE_CHECKING:
    from mesotap.api import (
        Answer,
        CrossCheck,
        Estimate,
        FrequencyResponse,
        MesotapError,
        RingDownModes,
        Session,
        SessionResults,
        contact_stiffness,
        diagnose,
        frf,
        identify,
        read_session,
        simulate,
        theory,
    )

__all__ = [
    "Answer",
    "CrossCheck",
    "Estimate",
    "FrequencyResponse",
    "MesotapError",
    "RingDownModes",
    "Session",
    "SessionResults",
    "__version__",
    "contact_stiffness",
    "diagnose",
    "frf",
    "identify",
    "read_session",
    "simulate",
    "theory",
]


def __getattr__(name: str) -> Any:
    """Import what is asked for when it is asked for: the command line starts without it."""
    if name in __all__:
        from mesotap import api

        return getattr(api, name)
    raise AttributeError(f"module 'mesotap' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
