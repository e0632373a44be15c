"""Run a command within limits, and write what it took: ``within_limits.py REPORT BYTES SECONDS COMMAND...``.

The system counts as the largest memory of a process what its parent had when it began. The tests' own process may have
gigabytes; this one is small.
"""

import os
import resource
import sys
import time
from pathlib import Path


def main() -> None:
    report, memory, longest_s, *command = sys.argv[1:]
    resource.setrlimit(resource.RLIMIT_AS, (int(memory), int(memory)))
    began = time.monotonic()
    child = os.spawnv(os.P_NOWAIT, command[0], command)
    while True:
        ended, status, usage = os.wait4(child, os.WNOHANG)
        if ended:
            break
        if time.monotonic() - began > float(longest_s):
            os.kill(child, 9)
        time.sleep(0.01)
    took = f"{os.waitstatus_to_exitcode(status)} {usage.ru_utime + usage.ru_stime} {1024 * usage.ru_maxrss}"
    Path(report).write_text(took, encoding="ascii")


main()
