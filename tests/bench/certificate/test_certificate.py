"""Certificates: one page, every budget adds up, a simulation says that it is one, what is not kept is said."""

import json
import re
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from bench.certificate.content import MOST_FIGURES, figures_table
from bench.certificate.pdf import width_of, wrapped
from bench.certificate.write import write_certificate
from bench.cli.certificate import command
from bench.errors import UserMistake
from bench.verify.verify import verify
from tests.bench.analyses.test_calibration import BENCH, CALIBRATION, QUICK
from tests.bench.campaigns import run_campaign


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return run_campaign(tmp_path_factory.mktemp("certified"), "quick", QUICK + CALIBRATION, BENCH).folder


@pytest.fixture(scope="module")
def grid(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return run_campaign(tmp_path_factory.mktemp("grid"), "grid").folder


class Text(HTMLParser):
    """What a reader sees of a page."""

    def __init__(self) -> None:
        super().__init__()
        self.words: list[str] = []

    def handle_data(self, data: str) -> None:
        self.words.append(data)


def text_of(path: Path) -> str:
    parser = Text()
    parser.feed(path.read_text(encoding="utf-8"))
    return " ".join(parser.words)


def test_the_page_has_what_a_certificate_must_have(run: Path) -> None:
    done = CliRunner().invoke(command, [str(run), "--dut", "NAV-1"])
    assert done.exit_code == 0, done.output
    text = text_of(run / "certificate-NAV-1.html")
    raw = json.loads((run / "analyses" / "calibration.json").read_text())["NAV-1"]["conditions"]["raw_data"]["sha256"]
    for part in ("NAV-1", "quick", "virtual-metrics", "Watlow F4", "FAIL", "not kept by this unit: Kn", raw):
        assert part in text
    assert "no calibration of hardware" in text and "Welch and Satterthwaite" in text
    assert "Uncertainty budget of B0" in text and "gyro noise, correlated" in text
    assert "latitude 40 deg" in text and "table 35 ppm" in text


def test_the_pdf_is_one_page_of_a4_with_text(run: Path) -> None:
    written = write_certificate(run, "NAV-1", None)
    data = written.files[1].read_bytes()
    assert data.startswith(b"%PDF") and len(re.findall(rb"/Type /Page\b", data)) == 1
    box = [float(one) for one in re.findall(rb"/MediaBox \[ *([^]]*)\]", data)[0].split()]
    assert box == pytest.approx([0.0, 0.0, 595.28, 841.89], abs=0.1)
    assert b"/FontFile2" in data and b"/ToUnicode" in data  # embedded TrueType: it can be searched
    assert write_certificate(run, "NAV-1", None).files[1].read_bytes() == data


def test_it_is_no_part_of_what_is_verified(run: Path) -> None:
    write_certificate(run, "NAV-1", None)
    assert not [finding for check in verify(run).checks for finding in check.findings]


def test_budgets_add_up(run: Path) -> None:
    budgets = write_certificate(run, "HIGH-1", None).document["calibration"]["budgets"]
    assert set(budgets) == {"B0", "K"}
    figures = {one["symbol"]: one for one in figures_of(run, "HIGH-1")}
    for symbol, budget in budgets.items():
        parts = np.array([row["contribution"] for row in budget["rows"]])
        assert budget["u"] == pytest.approx(np.sqrt(np.sum(parts**2)))
        assert budget["expanded"] == pytest.approx(budget["k"] * budget["u"])
        for row in budget["rows"]:
            assert row["contribution"] == pytest.approx(abs(row["sensitivity"]) * row["value"] / row["divisor"])
        unit = 1e6 / figures[symbol]["value"] if symbol == "K" else 1.0
        assert budget["u"] == pytest.approx(figures[symbol]["u"] * unit, rel=1e-6)
        assert 2.0 * budget["expanded"] == pytest.approx(
            (figures[symbol]["high"] - figures[symbol]["low"]) * unit, rel=1e-3
        )


def figures_of(run: Path, dut: str) -> list[dict[str, Any]]:
    found: list[dict[str, Any]] = json.loads((run / "analyses" / "calibration.json").read_text())[dut]["figures"]
    return found


def test_every_compensated_point_has_its_budget(grid: Path) -> None:
    written = write_certificate(grid, "FOG-A01", "linear")
    made = written.document["compensated"]
    metrics = json.loads((grid / "metrics.json").read_text())["FOG-A01"]["linear"]["leave_temperatures_out"]
    assert len(made["points"]) == 28 and made["residual_std_dps"] == metrics["std_dps"]
    for one in made["points"]:
        parts = one["contributions_dph"]
        assert one["u_dph"] == pytest.approx(np.sqrt(sum(part**2 for part in parts.values())))
        assert one["expanded_dph"] == pytest.approx(one["k"] * one["u_dph"])
        assert parts["model residual"] == pytest.approx(metrics["std_dps"] * 3600.0)
        # 50 ppm, the usual half-width of a table, of the rate that it turns at.
        assert parts["table rate"] == pytest.approx(abs(one["rate_dps"]) * 3600.0 * 50e-6 / np.sqrt(3.0))
        # This bench states no latitude, so the earth's rotation may be anything up to all of it.
        assert parts["earth rate: latitude not stated"] == pytest.approx(15.041067 / np.sqrt(3.0))
    text = text_of(written.files[0])
    assert "Compensated rate, model linear" in text and "latitude not stated" in text and "usual values" in text


def test_mistakes(run: Path, grid: Path, tmp_path: Path) -> None:
    with pytest.raises(UserMistake, match=r"no model 'ts_jont' of FOG-A01. Allowed: linear"):
        write_certificate(grid, "FOG-A01", "ts_jont")
    with pytest.raises(UserMistake, match=r"there is no DUT 'NAV-2'.*Did you mean NAV-1"):
        write_certificate(run, "NAV-2", None)
    done = CliRunner().invoke(command, [str(run)])
    assert isinstance(done.exception, UserMistake) and "--dut NAV-1 or --dut HIGH-1" in str(done.exception)
    (tmp_path / "journal.jsonl").write_bytes((run / "journal.jsonl").read_bytes())
    with pytest.raises(UserMistake, match="has not ended"):
        write_certificate(tmp_path, "NAV-1", None)


def test_too_many_figures_are_drawn_together_by_range_or_by_the_largest() -> None:
    def figure(symbol: str, value: float) -> dict[str, Any]:
        about = {"symbol": symbol, "name": symbol, "unit": "ppm", "n": 5, "at": f"{value:g} degC"}
        return about | {"value": value, "u": 0.1, "low": value - 0.2, "high": value + 0.2}

    many = [figure(symbol, float(k)) for k in range(MOST_FIGURES) for symbol in ("K", "Kn")]
    rows = {row[0]: row for row in figures_table(many, {"Kn": 9.0}).rows}
    assert rows["K"][2] == f"0.00 to {MOST_FIGURES - 1}.00" and rows["Kn"][2] == f"{MOST_FIGURES - 1}.00"
    assert rows["Kn"][-1] == "≤ 9" and rows["Kn"][6] == f"largest of {MOST_FIGURES}"
    assert len(figures_table(many[:4], {}).rows) == 4


def test_lines_are_no_wider_than_their_column() -> None:
    text = "a sentence with a_very_long_word_that_no_line_of_this_width_can_hold in it"
    lines = wrapped(text, 8.0, 90.0)
    assert all(width_of(line, 8.0) <= 90.0 for line in lines)
    assert "".join(lines).replace(" ", "") == text.replace(" ", "")
