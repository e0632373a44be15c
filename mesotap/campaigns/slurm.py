"""Workers that are jobs of SLURM, through dask's own adapter."""

from __future__ import annotations

import contextlib
import shutil
import subprocess
import time
import warnings
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

import pydantic

from mesotap.campaigns.errors import CampaignError
from mesotap.configuration.config import ConfigError, text_of
from mesotap.configuration.yaml_text import NOT_YAML, not_yaml, parsed

if TYPE_CHECKING:
    from dask_jobqueue import SLURMCluster

LOOK_S = 10.0  # between looks at the queue
CLOSE_S = 30.0  # that cancelling them may take
QUEUE_S = 60.0  # that squeue may take
SUBMIT_S = 600.0  # that submitting all jobs may take
SQUEUE = ("squeue", "--me", "--noheader", "--format=%A")


class Jobs(pydantic.BaseModel):
    """What the YAML of ``--cluster slurm:FILE`` holds.

    Attributes
    ----------
    jobs
        Jobs that are kept in the queue or running.
    cores
        Of each job: so many workers with one thread.
    memory
        Of each job, such as ``16GB``.
    walltime
        Of each job, such as ``04:00:00``; one that ends is replaced.
    partition, account
        Of SLURM.
    directives
        Further lines of ``#SBATCH``.
    prologue
        Lines of shell before the workers: modules, a virtual environment.
    python
        The interpreter there, with mesotap and its extra ``cluster``.
    interface
        Network by which jobs reach this machine, such as ``ib0``.
    log_directory
        Where SLURM writes what jobs say.
    longest_wait_s
        How long there may be no worker at all before the campaign stops.
    """

    model_config = pydantic.ConfigDict(extra="forbid", strict=True)

    jobs: int = pydantic.Field(ge=1, le=10_000)
    cores: int = pydantic.Field(1, ge=1, le=1024)
    memory: str = pydantic.Field(pattern=r"^\d+(\.\d+)? ?[KMGT]i?B$")
    walltime: str = pydantic.Field("01:00:00", pattern=r"^(\d+-)?\d{1,2}:\d{2}:\d{2}$")
    partition: str | None = None
    account: str | None = None
    directives: list[str] = []
    prologue: list[str] = []
    python: str | None = None
    interface: str | None = None
    log_directory: str | None = None
    longest_wait_s: float = pydantic.Field(86_400.0, gt=0, strict=False)


def read_jobs(path: Path) -> Jobs:
    """Read the YAML that describes the jobs.

    Raises
    ------
    CampaignError
        It is none; the message has a fault for each key.
    """
    try:
        _, content = parsed(text_of(path, "the description of SLURM jobs"))
    except ConfigError as error:
        raise CampaignError(str(error)) from error
    except NOT_YAML as error:
        raise CampaignError(not_yaml(str(path), error)) from error
    try:
        return Jobs.model_validate(content if content is not None else {})
    except pydantic.ValidationError as error:
        faults = [f"{'.'.join(map(str, e['loc'])) or 'the description'}: {e['msg']}" for e in error.errors()]
        raise CampaignError(f"{path}: {'; '.join(faults)}") from error


class Slurm:
    """A scheduler in this process, and jobs that are submitted again when they end.

    Dask's adapter submits jobs and cancels them. That a job ended, at its walltime or with its node, it does not see
    (measured: a killed job was never replaced); for that the queue is looked at here.
    """

    def __init__(self, path: Path) -> None:
        self.name = f"slurm:{path}"
        self._jobs = read_jobs(path)
        if shutil.which("sbatch") is None:
            raise CampaignError(f"--cluster {self.name}: sbatch is not found; call mesotap where SLURM's commands are")
        self.patience_s = self._jobs.longest_wait_s
        self.advice = "look at 'squeue --me' and at what the jobs said (log_directory)"
        self.address = ""
        self._cluster: SLURMCluster | None = None
        self._looked = 0.0
        self._missed: set[str] = set()

    def look_after(self) -> None:
        """Submit the jobs, and again those that ended.

        Raises
        ------
        CampaignError
            The scheduler cannot be begun, or the first jobs are refused.
        """
        if self._cluster is None:
            self._begin()
        elif time.monotonic() - self._looked > LOOK_S:
            self._replace_ended(self._cluster)
        else:
            return
        self._looked = time.monotonic()

    def _begin(self) -> None:
        from dask_jobqueue import SLURMCluster

        jobs = self._jobs
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                self._cluster = cluster = SLURMCluster(
                    queue=jobs.partition,
                    account=jobs.account,
                    cores=jobs.cores,
                    processes=jobs.cores,
                    memory=jobs.memory,
                    walltime=jobs.walltime,
                    job_extra_directives=jobs.directives,
                    job_script_prologue=jobs.prologue,
                    python=jobs.python,
                    interface=jobs.interface,
                    log_directory=jobs.log_directory,
                    job_name="mesotap",
                    scheduler_options={"dashboard": False},
                )
            self.address = str(cluster.scheduler_address)
            self._submit(cluster, ended=())
        except (OSError, TimeoutError, ValueError, RuntimeError) as error:
            said = [line for line in str(error).splitlines() if line.strip()] or [type(error).__name__]
            raise CampaignError(f"--cluster {self.name}: no job could be submitted: {said[-1]}") from error

    def _replace_ended(self, cluster: SLURMCluster) -> None:
        """Have jobs that the queue does not know any more, twice in a row, submitted again."""
        try:
            said = subprocess.run(SQUEUE, capture_output=True, text=True, timeout=QUEUE_S, check=True).stdout
        except (OSError, subprocess.SubprocessError):
            return  # the queue cannot be asked at the moment
        there = set(said.split())
        jobs = {name: str(job.job_id or "") for name, job in dict(cluster.workers).items()}
        gone = {job for job in jobs.values() if job not in there}
        ended = [name for name, job in jobs.items() if job in gone & self._missed or not job]
        self._missed = gone
        if ended:
            with contextlib.suppress(Exception):  # refused: the next look tries again
                self._submit(cluster, ended)

    def _submit(self, cluster: SLURMCluster, ended: Iterable[str]) -> None:
        """Submit the jobs that are missing, without those that ended.

        Raises
        ------
        RuntimeError
            A job is refused; dask's own way to scale says nothing of that.
        """

        async def submit() -> None:
            for name in ended:
                cluster.workers.pop(name, None)
            while len(cluster.worker_spec) < self._jobs.jobs:
                cluster.worker_spec.update(cluster.new_worker_spec())
            await cluster._correct_state_internal()

        cluster.sync(submit, callback_timeout=SUBMIT_S)

    def close(self) -> None:
        """Cancel the jobs and end the scheduler."""
        if self._cluster is not None:
            self._cluster.sync(self._forget_refused, self._cluster)
            with contextlib.suppress(Exception):
                self._cluster.close(timeout=CLOSE_S)
            self._cluster = None

    @staticmethod
    async def _forget_refused(cluster: SLURMCluster) -> None:
        """Dask does not close a cluster with jobs that were never submitted, or that ended by themselves."""
        from distributed.core import Status

        there = [job for job in cluster.workers.values() if job.job_id]
        for job in cluster._created:
            if job not in there:
                job.status = Status.failed
