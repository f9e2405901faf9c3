"""Our acceptance procedure on the virtual bench: with everything in order, and with things that will happen one day."""

import pytest

BENCH = "benches/ours.yaml"
PROCEDURE = "procedures/acceptance.yaml"


@pytest.fixture(scope="session")
def healthy(session_virtual_bench):
    """One run with nothing wrong, which several tests look at."""
    return session_virtual_bench(BENCH).run(PROCEDURE)


def test_it_passes_on_a_healthy_bench(healthy):
    assert healthy.outcome == "PASS"
    assert healthy.exit_code == 0
    assert (healthy.points["verdict"] == "pass").all()


def test_the_compensation_is_worth_it(healthy):
    for dut, models in healthy.metrics.items():
        without, compensated = (models[name]["random"]["max_abs_dps"] for name in ("none", "linear"))
        assert compensated < without / 3, dut


def test_it_takes_less_than_half_a_day(virtual_bench):
    rehearsal = virtual_bench(BENCH).dry_run(PROCEDURE)
    assert rehearsal.failure is None
    assert not rehearsal.warnings
    assert rehearsal.duration_s < 4 * 3600


def test_a_compressor_that_fails_at_minus_ten_ends_the_run_and_keeps_what_was_measured(virtual_bench):
    bench = virtual_bench(BENCH).fault("weak_cooling", on="chamber", remaining=0.0, when={"setpoint_below": "-10 degC"})
    run = bench.run(PROCEDURE)
    assert run.outcome == "ERROR"
    assert run.exit_code == 3
    assert "ramp" in run.message
    assert set(run.points["chamber_setpoint_degc"]) == {40.0, 10.0}
    made_safe = [event["text"] for event in run.events if event["kind"] == "safe"]
    assert any("rate table: at rest" in text for text in made_safe)


def test_a_lossy_can_link_fails_its_gyro_and_no_other(virtual_bench):
    run = virtual_bench(BENCH).fault("loss", on="OURS-C01", probability=0.02).run(PROCEDURE)
    assert run.outcome == "FAIL"
    assert run.exit_code == 1
    bad = run.points[run.points["verdict"] != "pass"]
    assert set(bad["dut"]) == {"OURS-C01"}
    # Counted against the simulator's own log; what is lost beside a stretch that nobody read cannot be counted.
    truly_lost = sum(record.get("lost", 0) for record in run.faults)
    assert run.losses["OURS-C01"]["lost"] == pytest.approx(truly_lost, abs=5)
    assert run.losses["OURS-S01"]["lost"] == 0


def test_a_chamber_too_weak_is_told_before_hour_0(virtual_bench):
    rehearsal = virtual_bench(BENCH).simulation(chamber={"cooling_power": "60 W"}).dry_run(PROCEDURE)
    assert rehearsal.failure is not None
