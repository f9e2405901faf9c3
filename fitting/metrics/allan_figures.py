"""Figures of the Allan fit; the minimum of the curve and the coefficient B are two figures."""

from fitting.metrics.figure import Figure
from fitting.random_errors.allan_fit import AllanFit, Coefficient

_SOURCE = "IEEE Std 952 Allan variance annex"
_CURVE = "asymptote of the overlapping Allan deviation with slope"
_DEFINITIONS = {
    "Q": f"{_CURVE} -1, read at sqrt(3) s",
    "N": f"{_CURVE} -1/2, read at 1 h",
    "B": "flat part of the overlapping Allan deviation divided by 0.664",
    "K": f"{_CURVE} +1/2, read at 3 h",
    "R": f"{_CURVE} +1, read at sqrt(2) h",
}


def allan_figures(fit: AllanFit, n: int) -> list[Figure]:
    """Q, N, B, K, R of a fit to n samples, and the Allan minimum."""
    return [*(_coefficient(found, fit, n) for found in fit.coefficients), _minimum(fit, n)]


def _coefficient(found: Coefficient, fit: AllanFit, n: int) -> Figure:
    rule = "weighted non-negative least squares on the variance"
    limits = f"limits by parametric bootstrap, {100.0 * fit.coverage:g} %, {fit.draws} draws, seed {fit.seed}"
    claim = "" if found.claimed else "; not needed by the fit: only the upper limit is a statement"
    definition = f"{_DEFINITIONS[found.symbol]}; {rule}; {limits}{claim}"
    return Figure(
        found.name, found.symbol, found.value, found.unit, found.u, found.low, found.high, n, definition, _SOURCE
    )


def _minimum(fit: AllanFit, n: int) -> Figure:
    lowest = fit.minimum
    definition = (
        f"lowest point of the overlapping Allan deviation, at tau = {lowest.tau_s:.4g} s; white noise and rate random "
        "walk alone also have one: it is not the bias instability B"
    )
    u = 0.5 * (lowest.high_dph - lowest.low_dph) / 1.959963984540054
    return Figure(
        "Allan minimum",
        "sigma_min",
        lowest.deviation_dph,
        "deg/h",
        u,
        lowest.low_dph,
        lowest.high_dph,
        n,
        definition,
        _SOURCE,
    )
