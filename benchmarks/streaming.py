"""An hour of the recorder's stream through driver and trigger: lost samples, processor time, memory.

The device is emulated at its USB endpoint and counts its samples, time is virtual: what is measured is what this
program has to do in an hour, not how long an hour is. Run by `make streaming`; a number of seconds may be given.
"""

from __future__ import annotations

import sys
import time
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from daq.settings import Trigger
from daq.trigger import NoTap, record_impact
from rig import Accelerometers, Block, Impactor
from rig.drivers.recorder_settings import Usb1608Settings
from rig.drivers.usb1608 import Usb1608
from rig.settings import Wiring
from sim_backend.clock import VirtualClock
from sim_backend.emulators.counting import TURNS, CountingSource, numbers
from sim_backend.emulators.usb1608 import EmulatedUsb1608

HOUR_S = 3600.0
ALLOWED_SHARE = 0.15
ALLOWED_GROWTH_MB = 1.0
OUT_OF_REACH = Trigger(threshold_m_s2=1e6, pretrigger_samples=250, record_samples=5000, timeout_s=HOUR_S)


@dataclass
class Costs:
    """Processor time that is not the program's own, s, and what the samples said."""

    emulator_s: float = 0.0
    checks_s: float = 0.0
    samples: int = 0
    lost: int = 0
    wrong: int = 0
    resident_mb: list[float] = field(default_factory=list)


class Metered(EmulatedUsb1608):
    """The emulated device with a clock on its endpoint."""

    costs: Costs

    def bulk_in(self, length: int, timeout_s: float) -> bytes:
        begin = time.process_time()
        try:
            return super().bulk_in(length, timeout_s)
        finally:
            self.costs.emulator_s += time.process_time() - begin


class Checked(Accelerometers):
    """The driver, every sample of which is held against its number before the trigger sees it."""

    def __init__(self, driver: Usb1608, wiring: Wiring, costs: Costs) -> None:
        self.sample_rate_hz = driver.sample_rate_hz
        self.full_scale_m_s2, self.bits = driver.full_scale_m_s2, driver.bits
        self._driver, self._wiring, self._costs = driver, wiring, costs
        self._due = 0

    def start(self) -> None:
        self._driver.start()

    def stop(self) -> None:
        self._driver.stop()

    def read_block(self) -> Block:
        block = self._driver.read_block()
        begin = time.process_time()
        n = block.acceleration.shape[1]
        self._costs.lost += block.first_sample - self._due
        self._due = block.first_sample + n
        expected = (block.first_sample + np.arange(n)) % TURNS
        self._costs.wrong += int(np.count_nonzero(numbers(block, self._wiring) != expected))
        self._costs.samples += n
        if self._due // n % 20000 == 0:
            self._costs.resident_mb.append(resident_mb())
        self._costs.checks_s += time.process_time() - begin
        return block


class Nobody(Impactor):
    """Never taps."""

    def tap(self, load_mn: float, hint: str = "") -> None:
        pass


def resident_mb() -> float:
    """Memory of this process, MB."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * 4096 / 1e6


def stream(wiring: Wiring, seconds: float) -> tuple[Costs, float]:
    """Wait ``seconds`` for a tap that never comes; returns the costs and the program's own processor time, s."""
    clock, costs = VirtualClock(), Costs()
    device = Metered(CountingSource(clock, wiring), clock)
    device.costs = costs
    driver = Usb1608(wiring, Usb1608Settings(), clock, device.bus)
    driver.connect()
    begin = time.process_time()
    try:
        trigger = OUT_OF_REACH.model_copy(update={"timeout_s": seconds})
        record_impact(Checked(driver, wiring, costs), Nobody(), clock, trigger, 500.0)
    except NoTap:
        pass
    total = time.process_time() - begin
    return costs, total - costs.emulator_s - costs.checks_s


def main() -> int:
    """Print the numbers; 1 where one is not what was promised."""
    seconds = float(sys.argv[1]) if len(sys.argv) > 1 else HOUR_S
    sound = True
    for wiring in (Wiring(strain_gauge_input=None), Wiring()):
        costs, own_s = stream(wiring, seconds)
        share = own_s / seconds
        growth = max(costs.resident_mb[1:], default=0.0) - costs.resident_mb[0] if costs.resident_mb else 0.0
        print(
            f"{len(wiring.inputs())} x {wiring.sample_rate_hz:g} Hz for {seconds:g} s: {costs.samples} samples of each "
            f"input, {costs.lost} lost, {costs.wrong} wrong"
        )
        print(
            f"    driver and trigger {own_s:.1f} s of processor time, {share:.2%} of one core; "
            f"emulator {costs.emulator_s:.1f} s, checks {costs.checks_s:.1f} s; "
            f"memory {resident_mb():.0f} MB, grown by {growth:.2f} MB"
        )
        whole = costs.lost == costs.wrong == 0 and costs.samples >= seconds * wiring.sample_rate_hz
        sound &= whole and share < ALLOWED_SHARE and growth < ALLOWED_GROWTH_MB
    return 0 if sound else 1


if __name__ == "__main__":
    sys.exit(main())
