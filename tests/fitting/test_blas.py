"""Fits run on one BLAS thread, whatever the caller has set, and leave the setting as it was."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from threadpoolctl import threadpool_info, threadpool_limits  # type: ignore[import-untyped]

from fitting import takagi_sugeno
from fitting.blas import one_thread
from fitting.linear import LinearCompensation


def threads() -> set[int]:
    return {library["num_threads"] for library in threadpool_info() if library["user_api"] == "blas"}


def test_the_limit_holds_inside_and_is_lifted_outside() -> None:
    with threadpool_limits(2, user_api="blas"):
        with one_thread():
            assert threads() == {1}
        assert threads() == {2}


def test_an_exception_lifts_the_limit() -> None:
    with threadpool_limits(2, user_api="blas"):
        with pytest.raises(ValueError, match="NaN"):
            LinearCompensation().fit([[np.nan, 1.0]], [1.0])
        assert threads() == {2}


def test_estimators_fit_on_one_thread(monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[set[int]] = []
    search: Callable[..., Any] = takagi_sugeno._SEARCHES["joint"]

    def spy(*arguments: Any) -> Any:
        seen.append(threads())
        return search(*arguments)

    monkeypatch.setitem(takagi_sugeno._SEARCHES, "joint", spy)
    inputs = np.random.default_rng(0).normal(size=(30, 2))
    with threadpool_limits(2, user_api="blas"):
        takagi_sugeno.joint().fit(inputs, inputs[:, 1])
    assert seen == [{1}]
