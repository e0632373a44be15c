"""`sbatch`, `squeue` and `scancel` of a cluster that is this machine: jobs are processes, begun at once."""

from __future__ import annotations

import os
import signal
import stat
from pathlib import Path

SBATCH = """#!/bin/bash
# usage: sbatch SCRIPT
place=$(dirname "$(dirname "$(realpath "$0")")")
grep -q '^#SBATCH' "$1" || { echo "sbatch: error: no directives" >&2; exit 1; }
number=$(( $(ls "$place/scripts" | wc -l) + 1001 ))
while ! mkdir "$place/numbers/$number" 2>/dev/null; do number=$((number + 1)); done
cp "$1" "$place/scripts/$number"
setsid bash "$place/scripts/$number" >"$place/logs/$number" 2>&1 </dev/null &
echo $! >"$place/jobs/$number"
echo "Submitted batch job $number"
"""
SQUEUE = """#!/bin/bash
# usage: squeue --me --noheader --format=%A
[ "$*" = "--me --noheader --format=%A" ] || { echo "squeue: error: not emulated: $*" >&2; exit 1; }
place=$(dirname "$(dirname "$(realpath "$0")")")
for job in "$place"/jobs/*; do
  [ -e "$job" ] || continue
  if kill -0 "$(cat "$job")" 2>/dev/null; then basename "$job"; else rm "$job"; fi
done
"""
SCANCEL = """#!/bin/bash
place=$(dirname "$(dirname "$(realpath "$0")")")
[ -e "$place/jobs/$1" ] || { echo "scancel: error: Invalid job id $1" >&2; exit 1; }
kill -TERM -- "-$(cat "$place/jobs/$1")" 2>/dev/null
rm -f "$place/jobs/$1"
"""


class EmulatedSlurm:
    """The commands, in a folder that goes first into PATH."""

    def __init__(self, place: Path) -> None:
        self.place, self.commands = place, place / "commands"
        for part in ("commands", "scripts", "numbers", "logs", "jobs"):
            (place / part).mkdir(parents=True)
        for name, text in (("sbatch", SBATCH), ("squeue", SQUEUE), ("scancel", SCANCEL)):
            path = self.commands / name
            path.write_text(text, encoding="utf-8")
            path.chmod(path.stat().st_mode | stat.S_IXUSR)

    @property
    def path(self) -> str:
        """PATH with the commands first."""
        return f"{self.commands}{os.pathsep}{os.environ['PATH']}"

    def submitted(self) -> list[str]:
        """Scripts of the jobs that were submitted, in order."""
        return [path.read_text(encoding="utf-8") for path in sorted((self.place / "scripts").iterdir())]

    def running(self) -> dict[str, int]:
        """Numbers of the jobs that run, to their process groups."""
        jobs = {path.name: int(path.read_text()) for path in (self.place / "jobs").iterdir()}
        return {name: pid for name, pid in jobs.items() if _runs(pid)}

    def kill(self, job: str) -> None:
        """End a job as a node that fails does."""
        os.killpg(self.running()[job], signal.SIGKILL)


def _runs(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True
