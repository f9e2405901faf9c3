"""Bad replies under the real drivers: counted in the log, survived by retries or raised as what they are."""

from pathlib import Path

import pytest

from drivers.errors import BadReply, NoReply
from tests.simulated_hw.faults.worlds import chamber, fault, truth_of, wait, world


def test_no_reply_is_raised_after_the_drivers_tries(tmp_path: Path) -> None:
    with world(fault("no_reply", "chamber", at_s=10.0, for_s=20.0), truth=tmp_path) as bench:
        driver = chamber()
        assert driver.temperature_degc() == pytest.approx(25.0, abs=1.0)
        wait(bench, 11.0)
        with pytest.raises(NoReply, match="sim://chamber"):
            driver.temperature_degc()
        assert len(truth_of(tmp_path)) == 3
        wait(bench, 30.0)
        assert driver.temperature_degc() == pytest.approx(25.0, abs=1.0)


def test_requests_that_are_not_answered_are_carried_out() -> None:
    with world(fault("no_reply", "chamber", at_s=10.0, for_s=20.0)) as bench:
        driver = chamber()
        driver.temperature_degc()
        wait(bench, 11.0)
        with pytest.raises(NoReply):
            driver.set_setpoint_degc(40.0)
        assert bench.chamber.final_setpoint_degc == 40.0


def test_now_and_then_a_reply_is_missing_and_retries_get_over_it(tmp_path: Path) -> None:
    with world(fault("no_reply", "chamber", probability=0.1), truth=tmp_path):
        driver = chamber()
        readings = [driver.temperature_degc() for _ in range(200)]
    assert len(readings) == 200 and 10 < len(truth_of(tmp_path)) < 40


def test_late_replies_are_not_taken_for_answers_to_the_next_question(tmp_path: Path) -> None:
    late = fault("late_reply", "chamber", probability=0.1, delay_s=1.5)
    with world(late, truth=tmp_path) as bench:
        driver = chamber()
        driver.identify()
        for _ in range(60):
            assert driver.setpoint_degc() == 25.0
            assert driver.limits_degc() == (-60.0, 90.0)
        assert bench.env.now > 5.0
    assert {record["fault"] for record in truth_of(tmp_path)} == {"late_reply"}


@pytest.mark.parametrize("bits", [1, 3])
def test_garbled_modbus_replies_are_noticed_by_their_crc(bits: int, tmp_path: Path) -> None:
    with world(fault("garbled_reply", "chamber", probability=0.1, bits=bits), truth=tmp_path):
        driver = chamber()
        for _ in range(200):
            assert driver.setpoint_degc() == 25.0
    assert 10 < len(truth_of(tmp_path)) < 40


def test_garbled_replies_throughout_are_a_bad_reply() -> None:
    with world(fault("garbled_reply", "chamber", at_s=1.0)) as bench:
        driver = chamber()
        driver.identify()
        wait(bench, 2.0)
        with pytest.raises((BadReply, NoReply)):
            driver.temperature_degc()


def test_of_several_faults_the_first_that_strikes_takes_the_reply(tmp_path: Path) -> None:
    both = [fault("garbled_reply", "chamber", at_s=1.0), fault("no_reply", "chamber", at_s=1.0)]
    with world(*both, truth=tmp_path) as bench:
        driver = chamber()
        driver.identify()
        wait(bench, 2.0)
        with pytest.raises((BadReply, NoReply)):
            driver.identify()
    assert {record["fault"] for record in truth_of(tmp_path)} == {"garbled_reply"}
