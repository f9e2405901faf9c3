"""Switching a Watlow F4 chamber by the event output its maker wired, byte by byte and through the simulated one."""

import pytest
import serial
import simpy
from pymodbus.framer import FramerRTU
from pymodbus.pdu import DecodePDU
from pymodbus.pdu.register_message import ReadHoldingRegistersRequest, WriteSingleRegisterRequest

from drivers.chambers.watlow_f4 import WatlowF4
from drivers.ports import open_serial
from simulated_hw.physics.chamber import ChamberPlant
from simulated_hw.physics.parameters import ChamberParameters
from simulated_hw.wire import switchboard
from simulated_hw.wire.watlow_f4 import SimulatedWatlowF4

ADDRESS = "sim://test-f4-conditioning"
# Notes, chambers, section 3: event output n is register 2000 + 10 (n - 1).
EVENT_2 = 2010


class Heard:
    """The simulated controller, and every request it got."""

    def __init__(self, controller):
        self.env, self.baud, self.controller, self.requests = controller.env, controller.baud, controller, []

    def receive(self, data, now_s):
        self.requests.append(data)
        return self.controller.receive(data, now_s)


@pytest.fixture
def plant():
    return ChamberPlant(ChamberParameters(), seed=1)


@pytest.fixture
def heard(plant, monkeypatch):
    monkeypatch.setattr(serial, "protocol_handler_packages", ["simulated_hw.wire"])
    heard = Heard(SimulatedWatlowF4(simpy.Environment(), plant, {"conditioning_event": 2}))
    switchboard.attach(ADDRESS, heard)
    yield heard
    switchboard.detach(ADDRESS)


def driver(**settings):
    settings = WatlowF4.Settings(**settings)
    return WatlowF4(open_serial(ADDRESS, settings.baud, settings.reply_timeout_s), settings)


def frame(request):
    return FramerRTU(DecodePDU(False)).buildFrame(request)


def test_off_and_the_look_at_it_are_the_bytes_of_another_implementation(heard):
    f4 = driver(conditioning_event=2)
    f4.off()
    assert f4.is_off()
    assert heard.requests == [
        frame(WriteSingleRegisterRequest(address=EVENT_2, registers=[0], dev_id=1)),
        frame(ReadHoldingRegistersRequest(address=EVENT_2, count=1, dev_id=1)),
    ]


def test_a_setpoint_switches_on_before_it_is_set(heard):
    f4 = driver(conditioning_event=2)
    assert f4.is_off()
    f4.identify()
    del heard.requests[:]
    f4.set_setpoint_degc(-20.0)
    assert heard.requests[0] == frame(WriteSingleRegisterRequest(address=EVENT_2, registers=[1], dev_id=1))
    # the worked frame of the notes
    assert heard.requests[1] == bytes.fromhex("01 06 01 2C FF 38 09 DD")
    assert not f4.is_off()


def test_switched_off_the_machine_drifts_to_the_room_and_on_again_it_goes_on(heard, plant):
    f4, env = driver(conditioning_event=2), heard.env
    f4.set_setpoint_degc(-20.0)
    env.run(until=4 * 3600.0)
    assert f4.temperature_degc() == pytest.approx(-20.0, abs=0.5)
    f4.off()
    began_s = env.now
    env.run(until=began_s + 40 * 3600.0)
    # Alone with the room: the wall's 35 kJ/K and 3 kJ/K of air over 2 W/K, some five hours; the DUTs' 10 W warm it.
    assert f4.temperature_degc() == pytest.approx(25.0 + 10.0 / 2.0, abs=1.5)
    assert plant.power_percent(env.now) == 0.0
    f4.set_setpoint_degc(-20.0)
    env.run(until=env.now + 4 * 3600.0)
    assert f4.temperature_degc() == pytest.approx(-20.0, abs=0.5)


def test_without_an_event_nothing_is_switched(heard):
    f4 = driver()
    assert not f4.Settings().can_switch_off and f4.Settings(conditioning_event=8).can_switch_off
    f4.identify()
    del heard.requests[:]
    f4.set_setpoint_degc(-20.0)
    assert len(heard.requests) == 1
    for question in (f4.off, f4.is_off):
        with pytest.raises(ValueError, match="conditioning_event"):
            question()


@pytest.mark.parametrize("event", [0, 9, -1])
def test_events_that_there_are_none(event):
    with pytest.raises(ValueError, match=r"allowed are 1\.\.8"):
        WatlowF4.Settings(conditioning_event=event)
