"""The SCPI supply driver against the simulated supply, scripted answers, and instruments that are none."""

import pytest
import simpy

from drivers.errors import BadReply, NoReply, PortError, Refused
from drivers.power_supplies.scpi_supply import ScpiSupply, ScpiSupplySettings
from simulated_hw.physics.power import PowerHistory
from simulated_hw.physics.supply import SupplyParameters, SupplyPlant
from simulated_hw.wire import switchboard
from simulated_hw.wire.scpi_supply import SimulatedScpiSupply
from simulated_hw.wire.serial_port import SimulatedSerial

ADDRESS = "sim://test-supply"


class Scripted:
    """Answers the n-th line with the n-th of its answers (the last one for ever); keeps the lines."""

    baud = 9600

    def __init__(self, *answers):
        self.env, self.answers, self.lines = simpy.Environment(), answers, []

    def receive(self, data, now_s):
        self.lines += data.decode().splitlines()
        answers = [self.answers[min(n, len(self.answers)) - 1] for n in range(1, len(self.lines) + 1)]
        answer = answers[-1]
        return [(0.005, answer)] if answer else []


@pytest.fixture
def driver_of():
    def make(device, **settings):
        switchboard.attach(ADDRESS, device)
        return ScpiSupply(SimulatedSerial(ADDRESS, baudrate=9600), ScpiSupplySettings(**settings))

    yield make
    switchboard.detach(ADDRESS)


def plant(duts=2):
    return SupplyPlant(SupplyParameters(voltage_noise_v=0.0, current_noise_a=0.0), 1, duts, PowerHistory())


def test_switches_and_measures(driver_of):
    supply = plant()
    driver = driver_of(SimulatedScpiSupply(simpy.Environment(), supply, {"baud": 9600}), voltage_v=24.0)
    assert driver.identify().startswith("fogbench,")
    assert driver.is_on() and driver.voltage_v() == 28.0
    assert driver.current_a() == pytest.approx(2 * 0.35 * 1.8, rel=0.02)
    driver.switch(False)
    assert not driver.is_on() and not supply.on
    assert (driver.voltage_v(), driver.current_a()) == (0.0, 0.0)
    driver.switch(True)
    assert driver.is_on() and driver.voltage_v() == 24.0
    assert driver.fault() is None


def test_settings_beyond_the_supply_are_refused_with_its_own_words(driver_of):
    driver = driver_of(SimulatedScpiSupply(simpy.Environment(), plant(), {}), voltage_v=60.0, current_limit_a=1.0)
    with pytest.raises(Refused, match=r"'VOLT 60' was refused: error -222. Data out of range"):
        driver.switch(True)
    assert driver.fault() is None


def test_the_error_queue_is_a_fault(driver_of):
    driver = driver_of(
        Scripted(b'-310,"System error;over temperature"\n', b'-350,"Queue overflow"\n', b'0,"No error"\n')
    )
    assert driver.fault() == "System error;over temperature (-310); Queue overflow (-350)"


def test_what_stood_in_the_queue_before_is_not_the_next_commands_fault(driver_of):
    device = Scripted(b"ACME,PS1,7,2\n", b'-113,"Undefined header"\n', b'+0,"No error"\n')
    driver = driver_of(device)
    assert driver.identify() == "ACME,PS1,7,2"
    driver.switch(True)
    assert device.lines == ["*IDN?", "SYST:ERR?", "SYST:ERR?", "OUTP ON", "SYST:ERR?"]


def test_another_instrument_is_told_apart(driver_of):
    driver = driver_of(Scripted(b"KEITHLEY,2000,1,2\n"))
    with pytest.raises(BadReply, match=r"'KEITHLEY,2000,1,2' is neither 0, 1, OFF nor ON"):
        driver.is_on()
    with pytest.raises(BadReply, match="is no number"):
        driver.voltage_v()


def test_silence_and_noise(driver_of):
    device = Scripted(None)
    driver = driver_of(device, tries=2, reply_timeout_s=0.5)
    with pytest.raises(NoReply, match=r"no reply to 'OUTP\?' within 0.5 s \(2 tries\)"):
        driver.is_on()
    assert device.lines == ["OUTP?", "OUTP?"]
    device.answers = (b"\xfe\x81\xff\x55" * 40 + b"\n",)
    with pytest.raises(BadReply, match="no line of text"):
        driver.is_on()


def test_one_lost_answer_is_asked_for_again(driver_of):
    device = Scripted(None, b"1\n")
    assert driver_of(device).is_on()
    assert device.lines == ["OUTP?", "OUTP?"]


def test_a_port_that_goes_away(driver_of):
    driver = driver_of(Scripted(b"1\n"))
    driver._port.close()
    with pytest.raises(PortError):
        driver.is_on()


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"baud": 0}, "baud: 0"),
        ({"reply_timeout_s": 0.0}, "reply_timeout: 0 s"),
        ({"tries": 0}, "tries: 0"),
        ({"voltage_v": -1.0}, "voltage: -1 V; it must be above 0, like 28 V"),
        ({"current_limit_a": 0.0}, "current_limit: 0 A"),
    ],
)
def test_settings_are_checked(settings, message):
    with pytest.raises(ValueError, match=message):
        ScpiSupplySettings(**settings)
