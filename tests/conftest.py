"""What holds for every test: one BLAS thread, as the program itself runs, and the same drawn inputs each time."""

import os
import signal
from collections.abc import Iterator

import pytest

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy is imported anywhere

from hypothesis import HealthCheck, settings

from tests.turns import read_turn, turn_of

# what a shell starts in the background ignores Ctrl-C, and so would every process that a test ends with it
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

# HYPOTHESIS_PROFILE=searching draws other inputs at each run; neither depends on how quick the machine is
untimed = settings(deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.register_profile("same", untimed, derandomize=True)
settings.register_profile("searching", untimed, derandomize=False)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "same"))


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Of slow tests keep those whose turn it is, where ``MESOTAP_TURN`` (k/n) asks for one."""
    asked = os.environ.get("MESOTAP_TURN")
    if not asked:
        return
    turn, turns = read_turn(asked)
    mine = [not i.get_closest_marker("slow") or turn_of(i.nodeid, turns) == turn for i in items]
    config.hook.pytest_deselected(items=[i for i, kept in zip(items, mine, strict=True) if not kept])
    items[:] = [i for i, kept in zip(items, mine, strict=True) if kept]


@pytest.fixture(scope="session", autouse=True)
def in_forks() -> Iterator[None]:
    """Read files in forks of a small process, unless a test asks for `in_new_processes`; forks of the tests do so too.

    That a new process reads alike, tests of daq.limited and of commands in processes of their own show.
    """
    from tests.fuzz.forked import reading_in_forks

    with reading_in_forks():
        yield


@pytest.fixture
def in_new_processes(in_forks: None) -> Iterator[None]:
    """Read each file in a new process, as the program does."""
    from tests.fuzz.forked import reading_in_new_processes

    with reading_in_new_processes():
        yield
