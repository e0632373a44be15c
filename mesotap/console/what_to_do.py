"""What pages say is to be done, by where the session is."""

from __future__ import annotations

WHAT_TO_DO = {
    "CONNECT": "Nothing to do: the devices are being connected.",
    "PRE_CALIBRATION": "Hang each weight when it is asked for.",
    "APPROACH": "Keep off the rig: the surfaces are being brought together.",
    "SET_LOAD": "Keep off the rig: the load is being set.",
    "LOCK": "Keep off the rig: the load is locked and comes to rest.",
    "TAP": "Tap the upper mass once, lightly.",
    "RETRACT": "Keep off the rig: the surfaces are being taken apart.",
    "POST_CALIBRATION": "Hang each weight when it is asked for.",
    "FILE": "Nothing to do, the surfaces are apart: the session file is being written.",
    "DONE": "The session is complete: look at the report.",
}
BY_ITSELF = {
    "TAP": "Nothing to do: the simulated rig taps itself.",
    "PRE_CALIBRATION": "Nothing to do: the simulated rig hangs its weights itself.",
    "POST_CALIBRATION": "Nothing to do: the simulated rig hangs its weights itself.",
}
VIEW_IDLE = "Take the surfaces apart, then begin: what the gauge reads then counts as no load."
FILING = {
    "FILE": WHAT_TO_DO["FILE"],
    "REPORT": "Nothing to do, the surfaces are apart: the session is filed, and its report is being worked out.",
    "DIAGNOSIS": "The report is there, under Loads. STOP leaves the diagnosis out.",
}
AFTERWARDS = {
    "stopped": "The session ended; 'Resume' goes on with it.",
    "failed": "Look at the rig, mend what the alarm says, then 'Resume'.",
}
FOLDER_GONE = "The session's folder is gone, so there is nothing to resume: put it back, or start a new session."
IDLE = "No session runs. Start one, or go on with one that was not finished."
