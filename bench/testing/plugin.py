"""The pytest plugin: fixtures for a virtual bench. Loaded by every pytest, so the product is imported on first use."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from bench.testing.virtual import VirtualBench


@pytest.fixture
def virtual_bench(request: pytest.FixtureRequest, tmp_path: Path) -> Callable[..., VirtualBench]:
    """Makes virtual benches: virtual_bench("benches/ours.yaml").fault("door_open", on="chamber", at="30 min").run(…).

    The bench file is looked for in pytest's rootdir, then beside the test; without one it is the packaged virtual
    bench. Real ports are replaced by simulated ones. Runs are in tmp_path / "results".
    """
    node: Any = request.node

    def tell(text: str) -> None:
        node.add_report_section("call", "fogbench", text)

    return _maker(tmp_path, (request.config.rootpath, request.path.parent), tell)


@pytest.fixture(scope="session")
def session_virtual_bench(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> Callable[..., VirtualBench]:
    """`virtual_bench` for fixtures of wider scope: one run that many tests look at."""
    return _maker(tmp_path_factory.mktemp("fogbench"), (request.config.rootpath,), lambda text: None)


def _maker(folder: Path, roots: tuple[Path, ...], tell: Callable[[str], None]) -> Callable[..., VirtualBench]:
    def make(bench: str | Path | None = None) -> VirtualBench:
        from bench.testing.virtual import PACKAGED, Desk, VirtualBench

        desk = Desk(folder / "results", roots, tell)
        return VirtualBench(desk, PACKAGED if bench is None else desk.find(bench))

    return make
