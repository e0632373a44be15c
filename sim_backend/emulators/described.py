"""The emulated amplifier that a configuration asks for: the model of a preset's name, or the one it describes."""

from __future__ import annotations

from typing import Any

from sim_backend.emulators import amplifier_tables as tables
from sim_backend.emulators.amplifier import AmplifierModel
from sim_backend.emulators.amplifier_tables import Live, Table

MODELS = {"seneca-ze-sg3": "ze-sg3", "seneca-z-sg": "z-sg", "seneca-z-sg2": "z-sg2", "laumas-tlb": "tlb"}
ROOMY_MV_PER_V = 16.0  # of a cell that 10 N bring to 80 mV: more than the simulated gauge gives
SIZE = 0x2100  # registers of a described device: room for the maps in use
CONTENTS = {"counts": tables.RAW, "mv": tables.MV, "mv_per_v": tables.MV_PER_V, "load": tables.GROSS}


def amplifier_of(settings: Any, realistic: bool = False) -> AmplifierModel:
    """Return what the section ``rig.parts.load_cell`` says is connected.

    Parameters
    ----------
    settings
        That section. Only what an owner knows of the device is read from it: the model's name or its registers, the
        excitation, the cell's ratio and full scale, the worth of a count.
    realistic
        Whether it converts, filters and rounds as one sold does.
    """
    own = {"excitation_v": settings.excitation_v, "mv_per_count": settings.mv_per_count, "realistic": realistic}
    if realistic:
        own["ratio_mv_per_v"] = ROOMY_MV_PER_V
    # what the owner has set in the amplifier, if the section has room for it
    cell = {"ratio_mv_per_v": "cell_ratio_mv_per_v", "full_scale": "cell_full_scale"}
    own |= {mine: value for mine, theirs in cell.items() if (value := getattr(settings, theirs, None)) is not None}
    if settings.preset is not None:
        return AmplifierModel(MODELS[settings.preset], **own)
    return AmplifierModel("", described_table(settings.registers), **own)


def described_table(registers: Any) -> Table:
    """Return the table of a device whose registers a configuration describes."""

    def place(name: str) -> int | None:
        found: int | None = getattr(registers, name, None)
        return found

    def number(name: str) -> int | None:
        found = getattr(registers, name, None)
        return None if found is None else int(found.offset)

    live = [Live(registers.signal.offset, CONTENTS[registers.signal_is], registers.signal.kind)]
    status = place("status")
    if status is not None:
        live.append(Live(status, tables.STATUS, "uint16"))
    constants = {"firmware": tables.FIRMWARE, "unit": tables.UNIT_NEWTON}
    rates: dict[int, float] = dict(getattr(registers, "adc_rates_hz", {}))
    return Table(
        size=SIZE,
        constants={offset: value for name, value in constants.items() if (offset := place(name)) is not None},
        live=tuple(live),
        ratio=number("ratio"),
        full_scale=number("full_scale"),
        identity=place("identity"),
        functions=(tables.READ_HOLDING, tables.READ_INPUT),
        rates_hz=rates,
        rate=place("adc_rate"),
        rate_code=max(rates, key=rates.__getitem__, default=0),  # set up as fast as it goes
        word_order=registers.word_order,
        negative_bit=place("negative_bit"),
    )
