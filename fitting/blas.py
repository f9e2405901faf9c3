"""One BLAS thread while a model is fitted.

Our matrices are small: a second thread gains nothing on an idle machine; on a busy one every product waits for a thread
that is not running (measured on two busy cores: 45 fits in 1.3 s with one thread, in 17 to 100 s with two); and it
changes the order of summation, so that the same data and seed would not give the same model on another machine.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache

from threadpoolctl import ThreadpoolController  # type: ignore[import-untyped]


@cache
def _controller() -> ThreadpoolController:
    """Finding the libraries takes a millisecond; numpy's and scipy's are loaded by then, because we import them."""
    return ThreadpoolController()


@contextmanager
def one_thread() -> Iterator[None]:
    """Within this context BLAS calls of this process run on one thread."""
    with _controller().limit(limits=1, user_api="blas"):
        yield
