"""Runs that the report tests share: a small one, and the whole 703-point campaign of two DUTs."""

from pathlib import Path

import pytest

from bench.report.data import ReportData, read_run
from tests.bench.report.synthetic_run import load_polynomial, write_synthetic_run

SMALL_TEMPERATURES = (-30, -15, 0, 15, 30)
SMALL_RATES = (-180, -120, -60, 0, 60, 120, 180)


@pytest.fixture(scope="session")
def small_run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("results") / "small"
    return write_synthetic_run(folder, temperatures_degc=SMALL_TEMPERATURES, rates_dps=SMALL_RATES)


@pytest.fixture(scope="session")
def small(small_run: Path) -> ReportData:
    return read_run(small_run, load_polynomial)


@pytest.fixture(scope="session")
def campaign_run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_synthetic_run(tmp_path_factory.mktemp("results") / "campaign")
