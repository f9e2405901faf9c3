"""The simulated supply: what it answers, and what its error queue says."""

import pytest
import simpy

from simulated_hw.physics.power import PowerHistory
from simulated_hw.physics.supply import SupplyParameters, SupplyPlant
from simulated_hw.wire.scpi_supply import SimulatedScpiSupply

QUIET = SupplyParameters(voltage_noise_v=0.0, current_noise_a=0.0)


@pytest.fixture
def supply():
    return SupplyPlant(QUIET, 1, 2, PowerHistory())


@pytest.fixture
def device(supply):
    return SimulatedScpiSupply(simpy.Environment(), supply, {"baud": 19200})


def say(device, text, now_s=0.0):
    replies = device.receive(text.encode() + b"\n", now_s)
    assert all(delay_s > 0 for delay_s, _ in replies)
    return b"".join(reply for _, reply in replies).decode()


def test_the_output_switches_the_duts(device, supply):
    assert device.baud == 19200
    assert say(device, "OUTP?") == "1\n"
    assert say(device, "OUTPUT:STATE OFF", 10.0) == ""
    assert say(device, "outp?;:meas:volt?;curr?", 11.0) == "0;0.0000;0.0000\n"
    say(device, "OUTP 1", 70.0)
    assert supply.power.gaps(100.0) == [(10.0, 70.0)]
    assert say(device, "MEAS:SCAL:VOLT:DC?", 71.0) == "28.0000\n"


def test_more_current_while_starting(device):
    say(device, "OUTP OFF", 10.0)
    say(device, "OUTP ON", 70.0)
    assert float(say(device, "MEAS:CURR?", 70.0)) == pytest.approx(2 * 0.35 * 1.8, abs=1e-4)
    assert float(say(device, "MEAS:CURR?", 400.0)) == pytest.approx(2 * 0.35, abs=1e-3)


def test_too_low_a_voltage_or_current_and_the_duts_stop(device, supply):
    say(device, "VOLT 12", 5.0)
    assert not supply.power.is_on(6.0) and say(device, "MEAS:VOLT?", 6.0) == "12.0000\n"
    say(device, "SOUR:VOLT:LEV 28;:SOURce:CURRent 0.5", 7.0)
    assert not supply.power.is_on(8.0)
    assert say(device, "VOLT?;CURR?") == "28.0000;0.5000\n"
    say(device, "CURR 2", 9.0)
    assert supply.power.is_on(9.0)


@pytest.mark.parametrize(
    ("line", "entry"),
    [
        ("VOLT 99", '-222,"Data out of range"\n'),
        ("CURR -1", '-222,"Data out of range"\n'),
        ("VOLT much", '-104,"Data type error"\n'),
        ("OUTP 2", '-104,"Data type error"\n'),
        ("OUTP", '-109,"Missing parameter"\n'),
        ("INST:NSEL 2", '-113,"Undefined header"\n'),
        ("MEAS:POW?", '-113,"Undefined header"\n'),
    ],
)
def test_what_it_cannot_do_goes_into_the_queue(device, line, entry):
    assert say(device, line) == ""
    assert say(device, "SYST:ERR?") == entry
    assert say(device, "SYST:ERR:NEXT?") == '0,"No error"\n'
    say(device, line)
    say(device, "*CLS")
    assert say(device, "SYST:ERR?") == '0,"No error"\n'
