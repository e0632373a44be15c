"""Who may open the devices: udev rules for the person who sits at the machine.

The tag ``uaccess`` has logind give a device to whoever is logged in at this machine's screen, and to nobody else, in
``73-seat-late.rules``: the file has to sort before that. A mode of 0666 would open it to every user and service.
"""

from __future__ import annotations

from rig.drivers.usb1608_protocol import PRODUCT, VENDOR

FILE = "70-mesotap.rules"
FOLDER = "/etc/udev/rules.d"
BEFORE = "73-seat-late.rules"
"""What systemd reads the tag in; rules are read in the order of the files' names."""

ADAPTERS = {
    "0403": "FTDI: most RS-232 and RS-485 adapters",
    "104d": "Newport: CONEX-CC, an FTDI chip under Newport's own number",
    "067b": "Prolific PL2303",
    "10c4": "Silicon Labs CP210x",
    "1a86": "QinHeng CH340 and CH341",
    "4348": "QinHeng CH341, older ones",
}
"""Makers of the chips behind a serial port, by USB vendor number.

Each was read in the sources of the Linux kernel's drivers, in drivers/usb/serial: ``ftdi_sio_ids.h`` (FTDI_VID 0x0403;
NEWPORT_VID 0x104D with NEWPORT_CONEX_CC_PID 0x3002), ``pl2303.h`` (PL2303_VENDOR_ID 0x067b), ``cp210x.c`` (0x10C4,
0xEA60: Silicon Labs' factory default) and ``ch341.c`` (0x1a86, 0x7523; 0x4348, 0x5523). Under which of the first two an
SMC100CC with USB answers was not found; both are in the rules. The recorder's 0x09DB, 0x00EA is that of W. Jasper's
Linux driver (``usb-1608FS-Plus.h``); usb.ids has 09db as Measurement Computing Corp.
"""

INSTALL = (
    f"sudo install -m 644 {FILE} {FOLDER}/",
    "sudo udevadm control --reload",
    "sudo udevadm trigger",
)


def rules() -> str:
    """Return the text of the rules, with how to install them."""
    lines = [
        "# mesotap: the recorder and the serial ports for whoever is logged in at this machine ('mesotap udev').",
        f"# The name has to sort before {BEFORE}. To install:",
        *(f"#   {command}" for command in INSTALL),
        "# Over ssh nobody sits at the machine: there, the group dialout opens serial ports.",
        "",
        "# MCC USB-1608FS-Plus",
        f'SUBSYSTEM=="usb", ENV{{DEVTYPE}}=="usb_device", ATTR{{idVendor}}=="{VENDOR:04x}", '
        f'ATTR{{idProduct}}=="{PRODUCT:04x}", TAG+="uaccess"',
        "",
        "# serial ports of USB adapters; ModemManager, which asks each new one whether it is a modem, leaves them be",
    ]
    for vendor, what in ADAPTERS.items():
        lines += [
            f"# {what}",
            f'SUBSYSTEM=="tty", KERNEL=="ttyUSB[0-9]*|ttyACM[0-9]*", ATTRS{{idVendor}}=="{vendor}", TAG+="uaccess", '
            'ENV{ID_MM_PORT_IGNORE}="1"',
        ]
    lines += [
        "",
        "# an FTDI chip passes on at once what a device answers, not after 16 ms: the stage approaches twice as fast",
        'ACTION=="add|bind", SUBSYSTEM=="usb-serial", DRIVER=="ftdi_sio", ATTR{latency_timer}="1"',
    ]
    return "\n".join(lines) + "\n"


def is_early(name: str) -> bool:
    """Return whether udev reads a file of this name, and before the tag ``uaccess`` is acted on."""
    return name.endswith(".rules") and name < BEFORE
