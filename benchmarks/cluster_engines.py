"""Which engine carries a campaign over machines: dask.distributed, Ray and Parsl under the same faults.

300 tasks of 2 s on four workers. Every 20 s a worker that is busy is killed (SIGKILL), after 70 s what plays the
scheduler's part; one task kills its worker, one hangs, one takes too much memory. Tasks sleep, so that the trial
measures the engines and not the processor. What was done, and how often, is counted from files that the tasks
write: a result is complete or absent, and each start is a line of a log.

Each engine runs as it comes (--plain: its own retries and limits, everything handed over at once) and under the loop
that a campaign would put around it: limits in a process of the task's own, three failures put a task aside, processes
that ended are started again, and after a silence the connection is made anew and what is missing handed over again.

Each engine is imported only if it is asked for, and may sit in an environment of its own.

mesotap is the same through the package's own campaign and `--cluster local:4`.

usage: cluster_engines.py dask|ray|parsl|mesotap [--plain] [--tasks N] [--seconds S] [--seed N] [--folder DIR]
       [--json FILE]
"""

from __future__ import annotations

import argparse
import collections
import contextlib
import hashlib
import json
import os
import random
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

Settings = dict[str, Any]
WORKERS = 4
KILL_EVERY_S = 20.0
SCHEDULER_KILLED_AT_S = 70.0
TASK_LIMIT_S = 15.0  # of a task that takes 2 s
TASK_LIMIT_BYTES = 512 << 20
GREED_BYTES = 1200 << 20  # what the greedy task stops at where nothing stops it
ATTEMPTS = 3  # failures that put a task aside
QUIET_S = 40.0  # without an answer: the connection is made anew
PROGRAM_LIMIT_S = 480.0  # from outside: a program that has not ended is ended


# --- a task: run as a process of its own, or in the engine's worker -----------------------------------------------


def perform(folder: str, digest: str, kind: str, seconds: float, worker: int) -> str:
    """Do one task: note the start, misbehave as `kind` says, write the result whole."""
    with Path(folder, "started.log").open("a") as log:
        log.write(f"{digest} {worker} {time.time():.2f}\n")
    if kind == "kills":
        os.kill(worker, signal.SIGKILL)
    if kind == "hangs":
        time.sleep(3600)
    greed = []
    while kind == "greedy" and sum(map(len, greed)) < GREED_BYTES:
        greed.append(b"x" * (64 << 20))
        time.sleep(0.2)
    time.sleep(seconds)
    part = Path(f"{folder}/results/.{digest}.{os.getpid()}")
    part.write_text(json.dumps({"digest": digest, "kind": kind}))
    part.rename(f"{folder}/results/{digest}.json")
    with Path(folder, "finished.log").open("a") as log:
        log.write(f"{digest}\n")
    return digest


def in_process(*task: Any) -> str:
    """Do one task in a process of its own, with limits, that ends with the worker."""
    command = [sys.executable, "-I", __file__, "--task", json.dumps([*task, os.getpid()])]
    done = subprocess.run(command, stderr=subprocess.PIPE, timeout=TASK_LIMIT_S, check=False)
    if done.returncode:
        raise RuntimeError(done.stderr.decode()[-200:] or f"ended by signal {-done.returncode}")
    return str(task[1])


def in_worker(*task: Any) -> str:
    """Do one task in the engine's worker: what stops it is the engine."""
    return perform(*task, os.getpid())


def answer(script: str, how: str, *task: Any, walltime: float | None = None) -> str:
    """What is handed to an engine; it needs nothing but this file there. Parsl looks for the walltime here."""
    import runpy

    return str(runpy.run_path(script)[how](*task))


def limited(task: str) -> None:
    """Be the process of one task."""
    import ctypes
    import resource

    ctypes.CDLL(None).prctl(1, signal.SIGKILL)  # PR_SET_PDEATHSIG: nobody would hear this task's answer
    resource.setrlimit(resource.RLIMIT_AS, (TASK_LIMIT_BYTES, TASK_LIMIT_BYTES))
    perform(*json.loads(task))


# --- the engines ---------------------------------------------------------------------------------------------------


class Engine:
    """What is asked of an engine: start, take tasks, answer, be looked after, end."""

    def __init__(self, folder: Path, plain: bool) -> None:
        self.folder, self.plain = folder, plain
        self.flying: dict[str, Any] = {}
        self.client: Any = None

    def note_scheduler(self, pid: int) -> None:
        (self.folder / "scheduler.pid").write_text(str(pid))

    def start(self) -> None:
        raise NotImplementedError

    def submit(self, digest: str, *call: Any) -> None:
        raise NotImplementedError

    def answers(self) -> Iterator[tuple[str, BaseException | None]]:
        """Tasks that ended since the last call."""
        raise NotImplementedError

    def look_after(self) -> None:
        """Start again what ended."""

    def renew(self) -> None:
        """Make the connection anew; what was handed over is forgotten."""
        raise NotImplementedError

    def stop(self) -> None:
        """End everything that was started."""


class Dask(Engine):
    """Plain: LocalCluster. Looked after: `dask scheduler` and `dask worker`, each a process that is started again."""

    def start(self) -> None:
        import dask
        from distributed import Client, LocalCluster

        dask.config.set({"distributed.scheduler.allowed-failures": ATTEMPTS - 1})
        if self.plain:
            self.cluster = LocalCluster(WORKERS, threads_per_worker=1, memory_limit="512MB", dashboard_address=None)
            self.client = Client(self.cluster)
            return
        os.environ |= {"DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES": "0"}  # the loop counts
        self.address = f"tcp://127.0.0.1:{20000 + os.getpid() % 20000}"
        self.parts: dict[int, subprocess.Popen[bytes]] = {}
        self.look_after()
        self.client = Client(self.address, timeout=60)

    def look_after(self) -> None:
        if self.plain:
            return
        base = [sys.executable, "-m", "distributed.cli."]
        for part in range(WORKERS + 1):
            if part in self.parts and self.parts[part].poll() is None:
                continue
            scheduler = ["dask_scheduler", "--port", self.address.rsplit(":", 1)[1], "--no-dashboard"]
            worker = ["dask_worker", self.address, "--nthreads=1", "--no-dashboard", "--memory-limit=0"]
            worker += ["--death-timeout=30", f"--local-directory={self.folder}/scratch"]
            arguments = worker if part else scheduler
            command = [*base[:2], base[2] + arguments[0], *arguments[1:]]
            with (self.folder / "engine.log").open("a") as log:
                self.parts[part] = subprocess.Popen(command, stdout=log, stderr=log, start_new_session=True)
            if not part:
                self.note_scheduler(self.parts[0].pid)
                if self.client:
                    self.renew()

    def submit(self, digest: str, *call: Any) -> None:
        self.flying[digest] = self.client.submit(answer, *call, key=f"{digest}-{time.monotonic_ns()}", pure=False)

    def answers(self) -> Iterator[tuple[str, BaseException | None]]:
        for digest, future in list(self.flying.items()):
            if future.status != "pending":
                del self.flying[digest]
                lost = ConnectionError("cancelled") if future.status in ("cancelled", "lost") else None
                yield digest, lost or (future.exception(timeout=10) if future.status == "error" else None)

    def renew(self) -> None:
        from distributed import Client

        self.flying.clear()
        old, self.client = self.client, None
        threading.Thread(target=lambda: old.close(timeout=5), daemon=True).start()
        self.client = Client(self.address, timeout=60)

    def stop(self) -> None:
        with contextlib.suppress(Exception):
            self.client.close(timeout=5)
        if self.plain:
            self.cluster.close(timeout=10)
            return
        for part in self.parts.values():
            with contextlib.suppress(ProcessLookupError):
                os.killpg(part.pid, signal.SIGKILL)


class Ray(Engine):
    """Plain: ray.init(). Looked after: a head and a node, started again when either ends."""

    def start(self) -> None:
        os.environ |= {"RAY_AUTH_MODE": "disabled", "RAY_USAGE_STATS_ENABLED": "0"}
        import ray

        self.ray = ray
        self.local = ray.init(
            num_cpus=WORKERS,
            include_dashboard=False,
            object_store_memory=100 << 20,
            _temp_dir=f"/tmp/ray-{os.getpid()}",
            log_to_driver=False,
        )
        self.call = ray.remote(answer).options(num_cpus=1, max_retries=ATTEMPTS - 1 if self.plain else 0)
        own = set(subprocess.run(["pgrep", "-x", "gcs_server"], capture_output=True, text=True).stdout.split())
        mine = [int(pid) for pid in own if f"ray-{os.getpid()}/" in Path(f"/proc/{pid}/cmdline").read_text()]
        self.head = mine[0]
        self.note_scheduler(self.head)

    def submit(self, digest: str, *call: Any) -> None:
        self.flying[digest] = self.call.remote(*call)

    def answers(self) -> Iterator[tuple[str, BaseException | None]]:
        names = {ref: digest for digest, ref in self.flying.items()}
        ready, _ = self.ray.wait(list(names), num_returns=len(names), timeout=0.1) if names else ([], [])
        for ref in ready:
            del self.flying[names[ref]]
            try:
                self.ray.get(ref, timeout=10)
                yield names[ref], None
            except Exception as error:
                yield names[ref], error

    def look_after(self) -> None:
        if not self.plain and " Z " in Path(f"/proc/{self.head}/stat").read_text():
            self.renew()

    def renew(self) -> None:
        self.flying.clear()
        self.ray.shutdown()
        self.start()

    def stop(self) -> None:
        self.ray.shutdown()


class Parsl(Engine):
    """The high-throughput executor with a block on this machine; the interchange is the scheduler."""

    def start(self) -> None:
        import parsl
        from parsl.config import Config
        from parsl.executors import HighThroughputExecutor
        from parsl.providers import LocalProvider

        self.parsl = parsl
        os.environ["PATH"] = f"{Path(sys.executable).parent}:{os.environ['PATH']}"  # its programs are found there
        self.executor = HighThroughputExecutor(
            address="127.0.0.1",
            max_workers_per_node=WORKERS,
            cores_per_worker=0.01,
            heartbeat_period=2,
            heartbeat_threshold=10,
            provider=LocalProvider(init_blocks=1, min_blocks=1, max_blocks=1),
            encrypted=False,
        )
        self.kernel = parsl.load(
            Config(
                executors=[self.executor],
                retries=ATTEMPTS - 1 if self.plain else 0,
                run_dir=str(self.folder / "runinfo"),
                strategy="none",
                usage_tracking=0,
            )
        )
        limits = {"walltime": TASK_LIMIT_S} if self.plain else {}
        self.limits, self.call = limits, parsl.python_app(answer, data_flow_kernel=self.kernel)
        self.note_scheduler(self.executor.interchange_proc.pid)

    def submit(self, digest: str, *call: Any) -> None:
        self.flying[digest] = self.call(*call, **self.limits)

    def answers(self) -> Iterator[tuple[str, BaseException | None]]:
        for digest, future in list(self.flying.items()):
            if future.done():
                del self.flying[digest]
                yield digest, future.exception()

    def look_after(self) -> None:
        if not self.plain and self.executor.interchange_proc.poll() is not None:
            self.renew()

    def renew(self) -> None:
        self.flying.clear()
        closing = threading.Thread(target=self.stop, daemon=True)
        closing.start()
        closing.join(20)
        self.parsl.clear()
        self.start()

    def stop(self) -> None:
        with contextlib.suppress(Exception):
            self.kernel.cleanup()


ENGINES = {"dask": Dask, "ray": Ray, "parsl": Parsl}


def through_mesotap(folder: Path, tasks: dict[str, str], seconds: float) -> None:
    """Be `mesotap ... --cluster local:4`: the same tasks as a campaign of this package."""
    from mesotap.campaigns.campaign import Campaign
    from mesotap.campaigns.cluster import Cluster
    from mesotap.campaigns.one_task import Limits
    from mesotap.campaigns.sites import Local
    from mesotap.campaigns.task import Task, content_sha256

    class Noted(Local):
        def look_after(self) -> None:
            super().look_after()
            (folder / "scheduler.pid").write_text(str(self._running[0].pid))

    program = f"""
import json, os, runpy, sys
runpy.run_path({str(Path(__file__).resolve())!r})["perform"](*json.loads(sys.argv[1]), os.getppid())
open("answer.json", "w").write("0")
""".encode()
    given = {"mesotap.py": content_sha256(program)}  # stands in the place of the package
    commands = {d: Task((json.dumps([str(folder), d, kind, seconds]),), given) for d, kind in tasks.items()}
    campaign = Campaign.plan(folder / "campaign", "a trial", commands, {given["mesotap.py"]: program})
    began = time.monotonic()
    with contextlib.closing(Cluster(Noted(WORKERS))) as engine:
        campaign.carry_out(engine, Limits(TASK_LIMIT_S, TASK_LIMIT_BYTES), lambda done, total: None)
    missing = sorted(d for d in tasks if campaign.state(d) != "done")
    aside = {d: campaign.failures(d)[-1][-160:] for d in missing if campaign.state(d) == "set aside"}
    said = {"seconds": time.monotonic() - began, "missing": missing, "aside": aside}
    (folder / "said.json").write_text(json.dumps(said, indent=1))


# --- the trial -----------------------------------------------------------------------------------------------------


def plan(number: int, seed: int) -> dict[str, str]:
    """Digest and kind of each task, the three bad ones anywhere."""
    digests = [hashlib.sha256(f"{seed}:{i}".encode()).hexdigest()[:16] for i in range(number)]
    bad = random.Random(seed).sample(digests, 3)
    return dict.fromkeys(digests, "good") | dict(zip(bad, ("kills", "hangs", "greedy"), strict=True))


def drive(name: str, folder: Path, tasks: dict[str, str], seconds: float, plain: bool) -> None:
    """Be the campaign: hand the tasks over, collect the answers, say what is missing."""
    engine = ENGINES[name](folder, plain)
    engine.start()
    began = last = time.monotonic()
    waiting, failures = collections.deque(tasks), collections.Counter[str]()
    aside: dict[str, str] = {}
    while waiting or engine.flying:
        while waiting and (plain or len(engine.flying) < WORKERS):
            digest = waiting.popleft()
            how = "in_worker" if plain else "in_process"
            engine.submit(digest, str(Path(__file__).resolve()), how, str(folder), digest, tasks[digest], seconds)
        handed = set(engine.flying)
        for digest, error in engine.answers():
            last = time.monotonic()
            if error is None or (folder / f"results/{digest}.json").exists():
                handed.discard(digest)
                continue
            failures[digest] += not isinstance(error, ConnectionError)
            if plain or failures[digest] >= ATTEMPTS:
                aside[digest] = f"{type(error).__name__}: {error}"[:160]
                handed.discard(digest)
        if not plain:
            engine.look_after()
            if time.monotonic() - last > QUIET_S:
                engine.renew()
                last = time.monotonic()
        lost = handed - set(engine.flying)
        waiting.extendleft(sorted(lost))
        time.sleep(0.1)
    missing = sorted(d for d in tasks if not (folder / f"results/{d}.json").exists())
    said = {"seconds": time.monotonic() - began, "missing": missing, "aside": aside}
    (folder / "said.json").write_text(json.dumps(said, indent=1))
    threading.Timer(30, lambda: os._exit(3)).start()  # an engine that does not end is left
    engine.stop()
    os._exit(0)


def busy(folder: Path) -> list[int]:
    """Workers with a task that was begun and is not finished."""
    log = folder / "started.log"
    starts = dict(line.split()[:2] for line in log.read_text().splitlines()) if log.exists() else {}
    pids = {int(pid) for d, pid in starts.items() if not (folder / f"results/{d}.json").exists()}
    return sorted(pid for pid in pids if Path(f"/proc/{pid}").exists())


def trial(options: argparse.Namespace, folder: Path) -> Settings:
    """Run the program, harm it, and count from outside."""
    (folder / "results").mkdir(parents=True, exist_ok=True)
    rng, killed, scheduler, began = random.Random(options.seed), 0, False, time.monotonic()
    with (folder / "program.log").open("w") as log:
        command = [sys.executable, __file__, *sys.argv[1:], "--folder", str(folder), "--drive"]
        program = subprocess.Popen(command, stdout=log, stderr=log, start_new_session=True)
        following: float | None = None
        while program.poll() is None and time.monotonic() - began < PROGRAM_LIMIT_S:
            time.sleep(0.2)
            now = time.monotonic()
            if following is None:
                if (folder / "started.log").exists():
                    following = began = now  # the faults begin with the first task
            elif now > following + KILL_EVERY_S and (pids := busy(folder)):
                with contextlib.suppress(ProcessLookupError):
                    os.kill(rng.choice(pids), signal.SIGKILL)
                    killed += 1
                following = now
            note = folder / "scheduler.pid"
            if following and not scheduler and now - began > SCHEDULER_KILLED_AT_S and note.exists():
                scheduler = True
                os.kill(int(note.read_text()), signal.SIGKILL)
        ended = program.poll()
        with contextlib.suppress(ProcessLookupError):
            os.killpg(program.pid, signal.SIGKILL)
    return counted(options, folder, {"killed": killed, "scheduler killed": scheduler, "exit": ended})


def counted(options: argparse.Namespace, folder: Path, told: Settings) -> Settings:
    """What the files say."""
    tasks = plan(options.tasks, options.seed)
    good = {digest for digest, kind in tasks.items() if kind == "good"}
    starts = collections.Counter(line.split()[0] for line in (folder / "started.log").read_text().splitlines())
    ends = collections.Counter((folder / "finished.log").read_text().split())
    said = json.loads((folder / "said.json").read_text()) if (folder / "said.json").exists() else {}
    done = {digest for digest in tasks if (folder / f"results/{digest}.json").exists()}
    return {
        "engine": options.engine,
        "plain": options.plain,
        **told,
        "seconds": said.get("seconds"),
        "good done": len(done & good),
        "good": len(good),
        "bad done": sorted(tasks[digest] for digest in done - good),
        "begun again": sum(starts[digest] - 1 for digest in good if starts[digest]),
        "finished twice": sum(ends[digest] - 1 for digest in good if ends[digest]),
        "aside": {tasks[digest]: why for digest, why in said.get("aside", {}).items()},
        "says what is missing": set(said["missing"]) == set(tasks) - done if said else False,
        "load": os.getloadavg()[0],
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("engine", nargs="?", choices=[*ENGINES, "mesotap"])
    parser.add_argument("--plain", action="store_true", help="the engine as it comes")
    parser.add_argument("--tasks", type=int, default=300)
    parser.add_argument("--seconds", type=float, default=2.0)
    parser.add_argument("--seed", type=int, default=23)
    parser.add_argument("--folder", type=Path)
    parser.add_argument("--json", type=Path)
    parser.add_argument("--drive", action="store_true", help=argparse.SUPPRESS)
    parser.add_argument("--task", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.task:
        limited(options.task)
    elif options.drive and options.engine == "mesotap":
        through_mesotap(options.folder, plan(options.tasks, options.seed), options.seconds)
    elif options.drive:
        drive(options.engine, options.folder, plan(options.tasks, options.seed), options.seconds, options.plain)
    else:
        result = trial(options, options.folder or Path(tempfile.mkdtemp(prefix="engines-")))
        print(text := json.dumps(result, indent=1))
        if options.json:
            options.json.write_text(text + "\n")


if __name__ == "__main__":
    main()
