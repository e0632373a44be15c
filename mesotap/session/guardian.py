"""Who takes the surfaces apart if the session's process dies, and what the two say to each other."""

from __future__ import annotations

from rig import GaugeScale

ARMED, APART, DISMISSED, BEAT = "armed", "apart", "dismissed", "beat"
SAYS, GOES_ON = "mesotap guardian: ", "'mesotap resume' goes on"  # how what it says begins, and may end
DIED = "the program died"
LARGEST_SETUP = 1 << 20  # bytes


class Guardian:
    """A guardian that does nothing: for rigs that die with the program."""

    def start(self) -> None:
        """Be ready before anything is loaded; `RigError` if that cannot be."""

    def scale(self, scale: GaugeScale) -> None:
        """Be told how the gauge reads."""

    def arm(self, load: bool) -> None:
        """Be told whether the surfaces may touch from now on."""

    def beat(self) -> None:
        """Be told that the program is alive; called a few times a second."""

    def leave(self) -> None:
        """Be told that the program takes the surfaces apart by itself now: nothing of the guardian may delay that."""

    def dismiss(self) -> None:
        """Be no longer needed."""
