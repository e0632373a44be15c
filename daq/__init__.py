"""From a `rig.Rig` to a session file: trigger, shot quality, journal, session format, exchange formats."""
