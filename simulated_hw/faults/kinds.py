"""The faults there are, by name, and which instruments can have them."""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Literal

from simulated_hw.faults.gyro_kinds import (
    BitError,
    BurstLoss,
    Duplicate,
    Frozen,
    Late,
    Loss,
    PowerReset,
    Silence,
    Spike,
    SyncSlip,
)
from simulated_hw.faults.instrument_kinds import (
    Alarm,
    DoorOpen,
    EncoderError,
    EStop,
    GarbledReply,
    LateReply,
    NoReply,
    OverSpeed,
    SensorBreak,
    Stuck,
    TableFault,
    WeakCooling,
)
from simulated_hw.faults.script import Script

Target = Literal["chamber", "rate_table", "supply", "dut"]


@dataclass(frozen=True)
class FaultSpec:
    """One fault as the bench file has it: its name, the instrument ('chamber', 'rate_table', 'supply' or a DUT's serial
    number), and what was said about it."""

    name: str
    on: str
    fault: Script


FAULTS: Mapping[str, type[Script]] = MappingProxyType(
    {
        "loss": Loss,
        "burst_loss": BurstLoss,
        "bit_error": BitError,
        "duplicate": Duplicate,
        "sync_slip": SyncSlip,
        "frozen": Frozen,
        "spike": Spike,
        "silence": Silence,
        "power_reset": PowerReset,
        "late": Late,
        "no_reply": NoReply,
        "late_reply": LateReply,
        "garbled_reply": GarbledReply,
        "fault": TableFault,
        "over_speed": OverSpeed,
        "e_stop": EStop,
        "encoder_error": EncoderError,
        "stuck": Stuck,
        "alarm": Alarm,
        "sensor_break": SensorBreak,
        "door_open": DoorOpen,
        "weak_cooling": WeakCooling,
    }
)

_REPLIES = ("no_reply", "late_reply", "garbled_reply")
# Which faults which instrument can have. On a CAN bus the controllers repeat a damaged frame by themselves (ISO 11898).
_OF: Mapping[Target, tuple[str, ...]] = MappingProxyType(
    {
        "chamber": (*_REPLIES, "alarm", "sensor_break", "door_open", "weak_cooling"),
        "rate_table": (*_REPLIES, "fault", "over_speed", "e_stop", "encoder_error", "stuck"),
        "supply": _REPLIES,
        "dut": tuple(list(FAULTS)[:10]),
    }
)
_NOT_ON_CAN = ("bit_error", "sync_slip")


def faults_of(target: Target, can: bool = False) -> list[str]:
    """Names of the faults that such an instrument can have."""
    return [name for name in _OF[target] if not (can and name in _NOT_ON_CAN)]
