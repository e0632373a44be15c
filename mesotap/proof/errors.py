"""What can be wrong with a proof's folder."""

from __future__ import annotations

from rig.errors import MesotapError


class ProofError(MesotapError):
    """A proof cannot be begun or gone on with, or its sessions are not those that were sealed; the message says why."""
