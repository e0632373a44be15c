"""What can be wrong with a campaign."""

from __future__ import annotations

from rig.errors import MesotapError


class CampaignError(MesotapError):
    """A campaign cannot be begun or gone on with; the message says why and what to do."""
