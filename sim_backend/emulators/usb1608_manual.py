"""What the maker and open drivers say of the USB-1608FS-Plus: ranges, pacer, memory, requests and their bits.

Sources
-------
G
    USB-1608FS-Plus User's Guide, page 11.
Q
    DAQFlex message-based firmware specification, page 30.
U
    uldaq, the maker's open driver: its files for this device.
J
    W. Jasper's Linux drivers, usb-1608FS-Plus.c and .h, whose comments describe each request.

docs/emulators.md tells what each of them confirms.
"""

from __future__ import annotations

CHANNELS = 8  # G p. 11
BITS = 16  # Q p. 30
RANGES_V = {0: 10.0, 1: 5.0, 3: 2.0, 5: 1.0}
"""Range by code (G p. 11 and Q p. 30: the ranges; U and J: the codes). Other codes are refused."""

CALIBRATED_RANGES = 8  # J: the memory has room for the codes in between
BASE_CLOCK_HZ = 40e6  # U, J
LARGEST_RATE_HZ = 100e3  # G, Q p. 30; the pacer does not run faster (J)
FIFO_SAMPLES = 32768  # J; Q p. 30: 32K samples

# requests and the bits of SCAN_START's options and of STATUS (U, J)
TRISTATE, PORT, LATCH = 0x00, 0x01, 0x02
SCAN_START, SCAN_STOP, SCAN_RANGES, CLEAR_FIFO = 0x11, 0x12, 0x14, 0x15
CALIBRATION, BLINK, RESET, STATUS, SERIAL = 0x30, 0x41, 0x42, 0x44, 0x48
IMMEDIATE, PACER_OUT, TRIGGERS, DEBUG, INHIBIT_STALL = 0x01, 0x02, 0x1C, 0x20, 0x80
RUNNING, OVERRUN = 1 << 1, 1 << 2
CALIBRATION_BYTES = 768
CALIBRATION_DATE = bytes([24, 3, 5, 10, 0, 0])  # at 0x200: year, month, day, hour, minute, second (J)
INPUTS = 0xFF  # tristate register: a 1 makes a line an input; what it is at power-on no page says
