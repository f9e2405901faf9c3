"""The benchmark beside other packages: the hand-over with made-up peers that work, hang, die or lie."""

import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from benchmarks import peer_environments, peers
from benchmarks.peer_runs import DataSets, Outcome, last_line, run
from benchmarks.peers import SCRIPTS, Peer

SETS, TRAIN, TEST = 3, 5, 4
OFFSETS = np.array([0.0, 0.1, -0.3, 0.4])  # largest 0.4, mean 0.05
# Learns one number, the mean of rate - output; both are arranged to differ by `set + 1` in the training rows.
PEER = """
import os, sys, time
sys.path.insert(0, {scripts!r})
from handover import main

class Shift:
    def fit(self, X, y):
        assert os.environ["OMP_NUM_THREADS"] == "1"
        self.shift = (y - X[:, 1]).mean()
        {while_fitting}

    def predict(self, X):
        return {prediction}

main("numpy", {{"shift": Shift}})
"""


@pytest.fixture
def data() -> DataSets:
    rng = np.random.default_rng(0)
    train, test = rng.uniform(-100.0, 100.0, (SETS, TRAIN, 2)), rng.uniform(-100.0, 100.0, (SETS, TEST, 2))
    shifts = np.arange(1.0, SETS + 1)[:, None]
    return DataSets(train, train[..., 1] + shifts, test, test[..., 1] + shifts - OFFSETS)


@pytest.fixture
def fake(tmp_path: Path, data: DataSets) -> Callable[..., Outcome]:
    """Runs a made-up peer; `while_fitting` is one statement."""

    def start(while_fitting: str = "pass", prediction: str = "X[:, 1] + self.shift", limit_s: float = 30.0) -> Outcome:
        script = tmp_path / "fake.py"
        script.write_text(
            PEER.format(scripts=str(SCRIPTS), while_fitting=while_fitting, prediction=prediction), encoding="utf-8"
        )
        return run([sys.executable, script, "shift"], tmp_path, data, SETS, limit_s)

    return start


def test_predictions_come_back_set_by_set_and_are_judged_here(fake: Callable[..., Outcome]) -> None:
    outcome = fake()
    assert outcome.trouble is None
    assert outcome.version == np.__version__
    assert outcome.largest_dps == pytest.approx([0.4] * SETS)
    assert outcome.std_dps == pytest.approx([np.std(OFFSETS)] * SETS)
    assert outcome.fit_s.shape == (SETS,)


def test_the_answers_are_not_handed_over(tmp_path: Path, data: DataSets) -> None:
    data.hand_over(tmp_path / "data.npz")
    with np.load(tmp_path / "data.npz") as arrays:
        assert sorted(arrays) == ["test_inputs", "train_inputs", "train_rate_dps"]
        assert np.array_equal(arrays["train_rate_dps"], data.train_rate_dps)


def test_a_peer_asked_for_fewer_sets_is_not_reproached(tmp_path: Path, data: DataSets) -> None:
    script = tmp_path / "fake.py"
    script.write_text(PEER.format(scripts=str(SCRIPTS), while_fitting="pass", prediction="X[:, 1] + self.shift"))
    outcome = run([sys.executable, script, "shift"], tmp_path, data, 1, 30.0)
    assert (len(outcome.fit_s), outcome.trouble) == (1, None)


def test_a_peer_that_hangs_is_stopped_and_keeps_what_it_finished(fake: Callable[..., Outcome]) -> None:
    outcome = fake("time.sleep(600.0 * (self.shift > 2.5))", limit_s=2.0)
    assert outcome.trouble == "stopped after 2 s"
    finished = len(outcome.fit_s)
    assert finished <= 2  # on a busy machine it may not have come so far
    assert outcome.largest_dps == pytest.approx([0.4] * finished)


@pytest.mark.parametrize(
    ("while_fitting", "prediction", "finished", "said"),
    [
        ("raise RuntimeError('no such kernel')", "X[:, 1]", 0, "ended with status 1: RuntimeError: no such kernel"),
        ("self.shift > 1.5 and os.kill(os.getpid(), 9)", "X[:, 1]", 1, "died of signal 9"),
        ("self.shift > 2.5 and os._exit(0)", "X[:, 1]", 2, "ended without the rest"),
        ("pass", "X[:, 1] * float('nan')", 0, "set 0 is unusable: predicted 0 finite rates of 4"),
        ("pass", "X[:2, 1]", 0, "set 0 is unusable: "),
    ],
)
def test_a_peer_that_fails_is_reported_in_one_line(
    fake: Callable[..., Outcome], while_fitting: str, prediction: str, finished: int, said: str
) -> None:
    outcome = fake(while_fitting, prediction)
    assert outcome.trouble is not None
    assert outcome.trouble.startswith(said)
    assert "\n" not in outcome.trouble
    assert len(outcome.fit_s) == len(outcome.std_dps) == finished


@pytest.mark.parametrize("written", ["{", "[]", '{"fit_s": 1.0}', "\udcff\n7", '{"version": 1, "fit_s": "x"'])
def test_results_that_are_torn_or_no_results_do_no_harm(tmp_path: Path, data: DataSets, written: str) -> None:
    script = tmp_path / "babble.py"
    script.write_text(
        f"import sys\nopen(sys.argv[3], 'wb').write({written.encode(errors='surrogateescape')!r} + b'\\n')"
    )
    outcome = run([sys.executable, script, "any"], tmp_path, data, SETS, 30.0)
    assert len(outcome.fit_s) == 0
    assert outcome.trouble is not None


def test_a_failing_peer_costs_the_others_nothing(
    tmp_path: Path, data: DataSets, monkeypatch: pytest.MonkeyPatch
) -> None:
    good = PEER.format(scripts=str(SCRIPTS), while_fitting="pass", prediction="X[:, 1] + self.shift")
    (tmp_path / "good.py").write_text(good)
    (tmp_path / "bad.py").write_text("raise ImportError('old numpy wanted')")
    monkeypatch.setattr(peers, "SCRIPTS", tmp_path)
    monkeypatch.setattr(peer_environments, "FOLDER", tmp_path / "none")
    table = [Peer("bad", "bad", "shift"), Peer("absent", "good", "shift", "pyfume"), Peer("good", "good", "shift")]
    found = [outcome for _, outcome in peers.outcomes(table, data, 30.0)]
    assert found[0].trouble == "ended with status 1: ImportError: old numpy wanted"
    assert found[1].trouble is not None and found[1].trouble.startswith("could not be started")
    assert found[2].trouble is None and len(found[2].fit_s) == SETS


def test_ratios_compare_the_sets_that_both_fitted() -> None:
    ours = Outcome("1", np.array([0.1, 0.1, 9.0]), np.array([0.2, 0.2, 9.0]), np.array([0.5, 0.5, 9.0]))
    theirs = Outcome("2", np.array([0.2, 0.2]), np.array([0.1, 0.1]), np.array([2.0, 2.0]), "stopped after 5 s")
    line = peers.row(Peer("RBF", "spline", "quintic"), theirs, ours)
    assert line.split()[:4] == ["RBF", "scipy", "2", "2"]
    assert line.split()[-7:-4] == ["2.00", "0.50", "4.00"]
    assert line.endswith("stopped after 5 s")


def maker_of(answer: str) -> Callable[..., None]:
    """Instead of `venv.create`: makes an environment whose python does nothing but this, whatever it is asked."""

    def make(folder: Path, with_pip: bool) -> None:
        python = peer_environments.python_of(folder.name)
        python.parent.mkdir(parents=True)
        python.write_text(f"#!/bin/sh\n{answer}\n")
        python.chmod(0o755)

    return make


def test_an_installation_that_fails_says_why_and_is_tried_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(peer_environments, "FOLDER", tmp_path)
    complaint = "ERROR: No matching distribution found for numpy==1.24.4"
    monkeypatch.setattr("venv.create", maker_of(f"echo '{complaint}'\necho note\nexit 1"))
    assert peers.install(["pyfume"]) == {"pyfume": f"pip: {complaint}"}
    assert not peer_environments.is_ready("pyfume") and not peers.any_installed()
    assert "installing pyfume" in capsys.readouterr().err


def test_a_complete_installation_is_used_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(peer_environments, "FOLDER", tmp_path)
    monkeypatch.setattr("venv.create", maker_of("exit 0"))
    assert peer_environments.install("xanfis") is None
    monkeypatch.setattr("venv.create", None)  # any further attempt would raise
    assert peer_environments.install("xanfis") is None
    assert peers.any_installed() and "xanfis" not in peers.missing()
    monkeypatch.setitem(peer_environments.REQUIREMENTS, "xanfis", ("xanfis==9",))
    assert not peer_environments.is_ready("xanfis")


@pytest.mark.parametrize("argv", [["--install", "nothing"], ["--seeds", "0"], ["--limit", "-1"]])
def test_options_that_make_no_sense_are_refused(argv: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        peers.arguments(argv)
    assert "error:" in capsys.readouterr().err


def test_every_row_has_a_script_and_every_environment_a_row() -> None:
    assert all((SCRIPTS / f"{peer.script}.py").exists() for peer in peers.PEERS)
    assert {peer.environment for peer in peers.PEERS} - {None} == set(peer_environments.REQUIREMENTS)


def test_the_last_line_prefers_the_one_with_the_prefix(tmp_path: Path) -> None:
    log = tmp_path / "log"
    log.write_text("ERROR: first\n\nERROR: last\nhint\n\n")
    assert (last_line(log, "ERROR"), last_line(log)) == ("ERROR: last", "hint")
    log.write_text("")
    assert last_line(log) == "it said nothing"
