"""What a tester is: the abstract `Rig`, its parts and readings, the interlock, and the parts that are hands."""

from rig.errors import (
    DeviceError,
    InterlockRefusal,
    MesotapError,
    NoAnswer,
    RigError,
    RigFailures,
    SessionAborted,
    StaleReading,
    together,
)
from rig.interface import Accelerometers, Clock, DeadWeights, Impactor, LoadCell, Operator, Rig, Stage
from rig.readings import Block, GaugeScale, LoadReading, StageReading

__all__ = [
    "Accelerometers",
    "Block",
    "Clock",
    "DeadWeights",
    "DeviceError",
    "GaugeScale",
    "Impactor",
    "InterlockRefusal",
    "LoadCell",
    "LoadReading",
    "MesotapError",
    "NoAnswer",
    "Operator",
    "Rig",
    "RigError",
    "RigFailures",
    "SessionAborted",
    "Stage",
    "StageReading",
    "StaleReading",
    "together",
]
