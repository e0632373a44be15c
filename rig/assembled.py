"""A real rig, put together from drivers and hands."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence

from rig.drivers.driver import Driver
from rig.errors import RigError, SessionAborted, together
from rig.interface import Accelerometers, Clock, DeadWeights, Impactor, LoadCell, Rig, Stage


class AssembledRig(Rig):
    """Parts of any make under one clock.

    Parameters
    ----------
    name
        What it is called.
    clock
        Rig time, the one that the parts were given.
    load_cell, stage, accelerometers, impactor, weights
        The parts; those that are a `Driver` are connected by `open`.
    """

    def __init__(
        self,
        name: str,
        clock: Clock,
        load_cell: LoadCell,
        stage: Stage,
        accelerometers: Accelerometers,
        impactor: Impactor,
        weights: DeadWeights,
    ) -> None:
        self.name = name
        self.clock = clock
        self.load_cell = load_cell
        self.stage = stage
        self.accelerometers = accelerometers
        self.impactor = impactor
        self.weights = weights

    def drivers(self) -> list[Driver]:
        """Return the parts that are connected, the stage first: it is what has to be stopped."""
        parts: Sequence[object] = (self.stage, self.load_cell, self.accelerometers, self.impactor)
        return [part for part in parts if isinstance(part, Driver)]

    def open(self) -> list[str]:
        """Connect every driver, and say of each what answered.

        Raises
        ------
        RigError
            A device did not; `RigFailures` where several did not. Those that did stay connected until `close`: a
            stage that answers can still take the surfaces apart.
        """
        lines: list[str] = []
        failures: list[Exception] = []
        for driver in self.drivers():
            try:
                lines.append(driver.connect())
            except SessionAborted:
                raise
            except Exception as error:
                failures.append(error)
                with contextlib.suppress(Exception):  # why it did not connect says more
                    driver.close()
        if not failures:
            try:
                self.impactor.release()
            except RigError as error:
                failures.append(error)
        if failures:
            raise together(failures)
        return lines

    def close(self) -> None:
        """Let go of every driver, whatever ails another.

        Raises
        ------
        RigError
            What failed, once all have been let go of.
        """
        failures: list[Exception] = []
        for driver in self.drivers():
            try:
                driver.close()
            except Exception as error:
                failures.append(error if isinstance(error, RigError) else RigError(f"while closing: {error}"))
        if failures:
            raise together(failures)
