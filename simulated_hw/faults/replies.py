"""A command/reply instrument whose replies go missing, come late or are damaged; requests reach it as ever."""

from collections.abc import Sequence

from simulated_hw.faults.draws import Events
from simulated_hw.faults.instrument_kinds import GarbledReply, LateReply
from simulated_hw.faults.log import FaultLog
from simulated_hw.faults.rules import Rule
from simulated_hw.wire.switchboard import Device


class BadlyAnswering:
    """Stands at the instrument's address in its place. A reply suffers the first of the faults that comes about."""

    def __init__(self, device: Device, rules: Sequence[Rule], log: FaultLog) -> None:
        self.env, self.baud = device.env, device.baud
        self._device, self._rules, self._log = device, rules, log
        self._replies = 0

    def receive(self, data: bytes, now_s: float) -> list[tuple[float, bytes]]:
        """What the instrument answers, as far as it arrives."""
        kept = []
        for delay_s, reply in self._device.receive(data, now_s):
            number, self._replies = self._replies, self._replies + 1
            rule = next((rule for rule in self._rules if self._strikes(rule, number, now_s)), None)
            if rule is None:
                kept.append((delay_s, reply))
                continue
            self._log.add(now_s, rule.spec.on, rule.spec.name, rule.number, replies=1, bytes=len(reply))
            if isinstance(rule.spec.fault, LateReply):
                kept.append((delay_s + rule.spec.fault.delay_s, reply))
            elif isinstance(rule.spec.fault, GarbledReply):
                kept.append((delay_s, _garbled(rule, rule.spec.fault, number, reply)))
        return kept

    def _strikes(self, rule: Rule, number: int, now_s: float) -> bool:
        assert isinstance(rule.draws, Events)
        return rule.windows.active(now_s) and len(rule.draws.between(number, number + 1)) > 0


def _garbled(rule: Rule, fault: GarbledReply, number: int, reply: bytes) -> bytes:
    damaged = bytearray(reply)
    bits = 8 * len(reply)
    for bit in rule.detail.chunk(number).choice(bits, min(fault.bits, bits), replace=False).tolist():
        damaged[bit // 8] ^= 0x80 >> bit % 8
    return bytes(damaged)
