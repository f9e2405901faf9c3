"""Bias instability and Allan minimum are two figures, and neither is the bias stability."""

import numpy as np
import pytest

from fitting.metrics.allan_figures import allan_figures
from fitting.metrics.bias import ScaleFactor, bias_stability
from fitting.random_errors.allan import allan_curve
from fitting.random_errors.allan_fit import fit_allan
from tests.fitting.random_errors import generators as g


def test_three_names_three_numbers() -> None:
    rng = np.random.default_rng(0)
    rate = g.white(rng, 43_200, 1.0, 0.005) + g.flicker(rng, 43_200, 1.0, 0.05)
    figures = {figure.symbol: figure for figure in allan_figures(fit_allan(allan_curve(rate, 1.0)), len(rate))}
    stability = bias_stability(rate, 1.0, 100.0, ScaleFactor(3600.0)).as_defined
    b, minimum = figures["B"], figures["sigma_min"]
    assert b.low < 0.05 < b.high
    assert minimum.value == pytest.approx(0.664 * 0.05, rel=0.2)
    assert len({round(figure.value, 4) for figure in (b, minimum, stability)}) == 3
    assert len({figure.name for figure in (b, minimum, stability)}) == 3
    assert "not the bias instability" in minimum.definition and "not the bias instability" in stability.source


def test_an_unneeded_term_says_that_only_its_limit_counts() -> None:
    rate = g.white(np.random.default_rng(1), 20_000, 1.0, 0.005)
    b = next(f for f in allan_figures(fit_allan(allan_curve(rate, 1.0)), len(rate)) if f.symbol == "B")
    assert b.low == 0.0 < b.high and "only the upper limit" in b.definition
