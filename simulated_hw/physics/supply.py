"""The power supply of the DUTs: one output, and what it measures there."""

from dataclasses import dataclass
from math import exp

from simulated_hw.physics.parameters import require_not_negative, require_positive
from simulated_hw.physics.power import PowerHistory
from simulated_hw.physics.streams import ReadingNoise, Stream

_READING_S = 0.1


@dataclass(frozen=True)
class SupplyParameters:
    """A laboratory supply with the DUTs at its output.

    Fields:
        voltage_v, current_limit_a: what it is set to at the beginning, its output on.
        max_voltage_v, max_current_a: what it can be set to.
        dut_current_a: what one DUT draws once it has warmed up. inrush: how much more at switching on, as a part of
            that, falling with the time constant inrush_s. lowest_voltage_v: below it a DUT does not run.
        voltage_noise_v, current_noise_a: of the readings.
    """

    voltage_v: float = 28.0
    current_limit_a: float = 3.0
    max_voltage_v: float = 36.0
    max_current_a: float = 6.0
    dut_current_a: float = 0.35
    inrush: float = 0.8
    inrush_s: float = 20.0
    lowest_voltage_v: float = 18.0
    voltage_noise_v: float = 0.002
    current_noise_a: float = 0.0005

    def __post_init__(self) -> None:
        require_positive(self, "voltage_v", "current_limit_a", "max_voltage_v", "max_current_a", "inrush_s")
        require_not_negative(self, "dut_current_a", "inrush", "lowest_voltage_v", "voltage_noise_v", "current_noise_a")


class SupplyPlant:
    """A supply and what it feeds. duts: how many; power: theirs, on while the output is and its voltage suffices."""

    def __init__(self, parameters: SupplyParameters, seed: int, duts: int, power: PowerHistory) -> None:
        self.parameters, self.duts, self.power = parameters, duts, power
        self.voltage_v, self.current_limit_a = parameters.voltage_v, parameters.current_limit_a
        self.on = True
        self._volt_noise = ReadingNoise(Stream(seed, "supply", "voltage readback"), _READING_S)
        self._ampere_noise = ReadingNoise(Stream(seed, "supply", "current readback"), _READING_S)

    def switch(self, now_s: float, on: bool) -> None:
        """Output on or off."""
        self.on = on
        self._feed(now_s)

    def set_voltage(self, now_s: float, voltage_v: float) -> None:
        """Raises ValueError beyond what it can do."""
        highest = self.parameters.max_voltage_v
        if not 0.0 <= voltage_v <= highest:
            raise ValueError(f"{voltage_v:g} V is outside 0 to {highest:g} V")
        self.voltage_v = voltage_v
        self._feed(now_s)

    def set_current_limit(self, now_s: float, current_a: float) -> None:
        """Raises ValueError beyond what it can do."""
        highest = self.parameters.max_current_a
        if not 0.0 < current_a <= highest:
            raise ValueError(f"{current_a:g} A is outside 0 to {highest:g} A")
        self.current_limit_a = current_a
        self._feed(now_s)

    def _feed(self, now_s: float) -> None:
        # A supply that limits its current lets its voltage sink: DUTs that draw more than it gives do not run.
        enough = self.duts * self.parameters.dut_current_a <= self.current_limit_a
        self.power.switch(now_s, self.on and enough and self.voltage_v >= self.parameters.lowest_voltage_v)

    def output_v(self, now_s: float) -> float:
        """A reading of the voltage."""
        held = self.on and (self.power.is_on(now_s) or self.voltage_v < self.parameters.lowest_voltage_v)
        return (self.voltage_v if held else 0.0) + self._volt_noise.at(now_s) * self.parameters.voltage_noise_v

    def output_a(self, now_s: float) -> float:
        """A reading of the current: at one voltage a DUT draws the same, and more while it starts."""
        p = self.parameters
        drawn = 0.0
        if self.power.is_on(now_s):
            ons_s = [at_s for at_s in self.power.commands_s if at_s <= now_s]
            since_s = now_s - ons_s[-1] if ons_s else now_s
            drawn = self.duts * p.dut_current_a * (1.0 + p.inrush * exp(-since_s / p.inrush_s))
        return min(drawn, self.current_limit_a) + self._ampere_noise.at(now_s) * p.current_noise_a
