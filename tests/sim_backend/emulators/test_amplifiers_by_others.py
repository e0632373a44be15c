"""Our amplifier driver at pymodbus' own server, filled by hand with the makers' register tables.

The server, its encoding of numbers and these tables share nothing with the driver or with the emulated amplifier. The
sources of each register are in `sim_backend.emulators.amplifier_tables`, whose registers are held against the same
tables below.
"""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Iterator
from contextlib import contextmanager

import pytest
from pymodbus import FramerType
from pymodbus.server import ModbusTcpServer
from pymodbus.simulator import DataType, SimData, SimDevice

from rig import Clock
from rig.drivers.amplifier import ModbusLoadCell
from rig.drivers.settings import PRESETS, AmplifierRtu, AmplifierTcp
from rig.drivers.transport import TcpTransport
from sim_backend.clock import RunningClock
from sim_backend.emulators.amplifier_tables import TABLES

F32, I32, U32, REGISTER = DataType.FLOAT32, DataType.INT32, DataType.UINT32, DataType.REGISTERS

# gross 1.25 N on a cell of 2 mV/V at 10 N, from 5 V: 1.25 mV
GROSS_N, RATIO_MV_PER_V, FULL_SCALE_N, MILLIVOLTS = 1.25, 2.0, 10.0, 1.25
MV_PER_COUNT = 1e-6
WEIGHTS = {63: (F32, GROSS_N), 65: (F32, GROSS_N), 67: (F32, 0.0), 69: (I32, 1), 71: (I32, 1), 73: (I32, 0)}
ZE_SG3 = {
    0: (REGISTER, 14),
    1: (REGISTER, 112),
    2: (REGISTER, 5),
    3: (REGISTER, 0),
    13: (F32, RATIO_MV_PER_V),
    15: (F32, FULL_SCALE_N),
    33: (REGISTER, 3),
    42: (REGISTER, 3),
    **WEIGHTS,
    77: (REGISTER, 0x10),
    91: (I32, 1250000),
    93: (I32, 1250000),
}
Z_SG = {0: (REGISTER, 14), 1: (REGISTER, 112), 51: (F32, 5000.0), 53: (F32, 1.0), 58: (REGISTER, 27), **WEIGHTS}
Z_SG2 = {0: (REGISTER, 14), 1: (REGISTER, 112), 2: (REGISTER, 0x0500), **WEIGHTS, 77: (REGISTER, 0x10)}
LAUMAS = {
    0: (REGISTER, 112),
    1: (REGISTER, 14),
    6: (REGISTER, 0x0800),
    7: (U32, 1250000),
    9: (U32, 1250000),
    13: (REGISTER, 0x040F),
}
BELOW_ZERO = {**LAUMAS, 6: (REGISTER, 0x0980)}  # bits 7 and 8: gross and net negative; bit 11: stable
CELL = {"cell_ratio_mv_per_v": RATIO_MV_PER_V, "cell_full_scale": FULL_SCALE_N}
LOW_WORDS = {"seneca-ze-sg3": (92, 94), "seneca-z-sg": (66, 64), "seneca-z-sg2": (66, 64), "laumas-tlb": (8, 10)}


@contextmanager
def served(table: dict, preset: str, framer: FramerType) -> Iterator[tuple[str, int]]:
    """Serve a table on this machine; the last bit of what is measured changes from one request to the next."""
    turn = 0

    async def noise(function, start, address, count, registers, values):
        nonlocal turn
        turn += 1
        for offset in LOW_WORDS[preset]:
            if address <= offset < address + count:
                registers[offset - start] ^= turn & 1
        return

    blocks, end = [], 0
    for offset in sorted(table):
        if offset > end:
            blocks.append(SimData(end, count=offset - end, values=0, datatype=REGISTER))
        kind, value = table[offset]
        blocks.append(SimData(offset, values=value, datatype=kind))
        end = offset + (1 if kind is REGISTER else 2)
    blocks.append(SimData(end, count=128 - end, values=0, datatype=REGISTER))
    device = SimDevice(1, blocks, action=noise)
    ready, loop, place = threading.Event(), asyncio.new_event_loop(), {}

    async def serve() -> None:
        server = ModbusTcpServer(device, framer=framer, address=("127.0.0.1", 0))
        await server.listen()
        place["server"] = server
        place["address"] = server.transport.sockets[0].getsockname()
        ready.set()

    thread = threading.Thread(target=loop.run_forever, daemon=True)
    thread.start()
    asyncio.run_coroutine_threadsafe(serve(), loop).result(10)
    ready.wait(10)
    try:
        yield place["address"]
    finally:
        asyncio.run_coroutine_threadsafe(place["server"].shutdown(), loop).result(10)
        loop.call_soon_threadsafe(loop.stop)
        thread.join(10)
        loop.close()


def read_mv(table: dict, preset: str, framing: str, **settings) -> float:
    """Return what the driver makes of a served table, mV."""
    framer = FramerType.SOCKET if framing == "tcp" else FramerType.RTU
    common = {"preset": preset, "reply_timeout_s": 2.0, "mv_per_count": MV_PER_COUNT, "readings_per_s": 50, **settings}
    section = (
        AmplifierTcp(driver="modbus-tcp", host="127.0.0.1", **common)
        if framing == "tcp"
        else AmplifierRtu(driver="modbus-rtu", port="none", **common)
    )
    clock: Clock = RunningClock()
    with served(table, preset, framer) as (host, port):
        wire = TcpTransport("strain-gauge amplifier", host, port)
        cell = ModbusLoadCell(wire, framing, section, clock)
        wire.open()
        try:
            cell.connect()
            return cell.read(0.1).voltage_mv
        finally:
            wire.close()


cells_are_settings = "cell_full_scale" in AmplifierRtu.model_fields  # else there is no preset for the Z-SG yet
known = {
    name: pytest.mark.skipif(name not in PRESETS or not cells_are_settings, reason="no preset of this name")
    for name in ("seneca-z-sg", "seneca-z-sg2")
}
MODELS = [
    pytest.param(ZE_SG3, "seneca-ze-sg3", "tcp", {}, id="ZE-SG3, TCP"),
    pytest.param(ZE_SG3, "seneca-ze-sg3", "rtu", {}, id="ZE-SG3, RTU"),
    pytest.param(Z_SG, "seneca-z-sg", "rtu", CELL, id="Z-SG", marks=known["seneca-z-sg"]),
    pytest.param(Z_SG2, "seneca-z-sg2", "rtu", CELL, id="Z-SG2", marks=known["seneca-z-sg2"]),
    pytest.param(LAUMAS, "laumas-tlb", "rtu", {}, id="TLB"),
]


@pytest.mark.parametrize(("table", "preset", "framing", "settings"), MODELS)
def test_the_driver_reads_the_makers_table(table, preset, framing, settings):
    assert read_mv(table, preset, framing, **settings) == pytest.approx(MILLIVOLTS, abs=1e-5)


def test_a_laumas_below_zero_is_read_with_its_sign():
    assert read_mv(BELOW_ZERO, "laumas-tlb", "rtu") == pytest.approx(-MILLIVOLTS, abs=1e-5)


@pytest.mark.parametrize(
    ("name", "table"), [("ze-sg3", ZE_SG3), ("z-sg", Z_SG), ("z-sg2", Z_SG2), ("tlb", LAUMAS)], ids=str
)
def test_the_emulated_amplifier_has_what_the_table_has_where_it_has_it(name, table):
    emulated = TABLES[name]
    places = set(emulated.constants) | {item.offset for item in emulated.live} | {emulated.identity}
    places |= {place for place in (emulated.ratio, emulated.full_scale, emulated.rate) if place is not None}
    assert set(table) <= places
    whole = {F32: "float32", I32: "int32", U32: "uint32", REGISTER: "uint16"}
    assert all(whole[table[item.offset][0]] == item.kind for item in emulated.live if item.offset in table)
