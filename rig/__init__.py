"""What a tester is: the abstract `Rig`, its parts and readings, the interlock, and the parts that are hands."""

from rig.errors import DeviceError, InterlockRefusal, NoAnswer, RigError, SessionAborted, StaleReading
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
    "NoAnswer",
    "Operator",
    "Rig",
    "RigError",
    "SessionAborted",
    "Stage",
    "StageReading",
    "StaleReading",
]
