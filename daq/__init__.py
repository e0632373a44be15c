"""From a `rig.Rig` to a session file: trigger, impact quality, journal, session format, exchange formats."""
