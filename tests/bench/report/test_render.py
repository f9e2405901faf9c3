import re
from html.parser import HTMLParser
from itertools import pairwise
from pathlib import Path

import pytest

from bench.errors import UserMistake
from bench.report.render import write_report
from tests.bench.report.synthetic_run import load_polynomial, write_synthetic_run

VOID = {"meta", "br", "hr", "img", "input", "link"}


class Page(HTMLParser):
    """What a browser would find: elements with their attributes, headings, and whether every element is closed."""

    def __init__(self, text: str) -> None:
        super().__init__(convert_charrefs=True)
        self.elements: list[tuple[str, dict[str, str | None]]] = []
        self.open: list[str] = []
        self.words: list[str] = []
        self.feed(text)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, dict(attrs)))

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.words.append(data)

    def values(self, attribute: str) -> list[str]:
        return [value for _, attributes in self.elements if (value := attributes.get(attribute)) is not None]

    @property
    def tags(self) -> list[str]:
        return [tag for tag, _ in self.elements]

    @property
    def text(self) -> str:
        return " ".join(" ".join(self.words).split())


@pytest.fixture(scope="module")
def text(campaign_run: Path) -> str:
    return write_report(campaign_run, load_polynomial).read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def page(text: str) -> Page:
    return Page(text)


def report_of(run: Path) -> Page:
    return Page(write_report(run, load_polynomial).read_text(encoding="utf-8"))


def test_the_campaign_fits_in_a_mail(text: str) -> None:
    assert len(text.encode()) < 2_500_000


def test_it_needs_nothing_from_outside(page: Page, text: str) -> None:
    links = page.values("href") + page.values("xlink:href") + page.values("src")
    assert links
    assert all(link.startswith(("#", "data:")) for link in links)
    assert not re.search(r"url\((?!#)|@import", text)
    assert not {"script", "link", "iframe", "object", "img"} & set(page.tags)
    policy = next(a["content"] for tag, a in page.elements if a.get("http-equiv") == "Content-Security-Policy")
    assert policy == "default-src 'none'; style-src 'unsafe-inline'; img-src data:"


def test_it_is_well_formed_and_its_references_hold(page: Page) -> None:
    assert not page.open
    ids = page.values("id")
    assert len(ids) == len(set(ids))
    targets = {link[1:] for link in page.values("href") + page.values("xlink:href")} | set(
        page.values("aria-labelledby")
    )
    assert targets <= set(ids)


def test_it_can_be_read_aloud(page: Page) -> None:
    assert ("html", {"lang": "en"}) in page.elements
    levels = [int(tag[1]) for tag in page.tags if re.fullmatch("h[1-6]", tag)]
    assert levels[0] == 1
    assert levels.count(1) == 1
    assert all(after <= before + 1 for before, after in pairwise(levels))
    drawings = [attributes for tag, attributes in page.elements if tag == "svg"]
    assert all(drawing["role"] == "img" and drawing["aria-label"] for drawing in drawings)
    scopes = [attributes.get("scope") for tag, attributes in page.elements if tag == "th"]
    assert set(scopes) <= {"row", "col", "colgroup"}


def test_it_shows_all_its_figures(page: Page) -> None:
    # Per DUT: scores, two surfaces, four residual panels, two maps; and the timeline and one dwell.
    assert page.tags.count("svg") == 2 * 9 + 2
    numbers = [int(n) for n in re.findall(r"Figure (\d+)\.", page.text)]
    assert numbers == list(range(1, len(numbers) + 1))


def test_it_says_what_matters(page: Page) -> None:
    for words in (
        "Virtual bench.",
        "PASS",
        "703 of 703",
        "158 h 45 min",
        "leave temperatures out",
        "after T-S joint, each point predicted by a model that never saw its dwell (right)",
        "These residuals are held-out errors",
        "one visit per temperature this run cannot tell them apart",
        "Std is the standard deviation of the error over the judged points",
        "11.6008",
        "fogbench run procedures/temperature_rate_grid.yaml --bench benches/virtual.yaml --seed 1",
    ):
        assert words in page.text


def test_a_run_that_passed_says_no_more_beside_its_badge(page: Page) -> None:
    assert "all limits met" not in page.text
    assert "Read this first" not in page.text


def test_the_same_run_gives_the_same_bytes(tmp_path: Path) -> None:
    run = write_synthetic_run(tmp_path / "r", duts=("a",), temperatures_degc=(0, 5, 10), rates_dps=(-20, 0, 20))
    first = write_report(run, load_polynomial).read_bytes()
    assert write_report(run, load_polynomial).read_bytes() == first


def test_text_from_files_is_never_markup(tmp_path: Path) -> None:
    names = ("<script>alert(1)</script>", '"><img src=x onerror=alert(2)>$\\frac{')
    run = write_synthetic_run(tmp_path / "r", duts=names, temperatures_degc=(0, 5, 10), rates_dps=(-20, -10, 10, 20))
    (run / "procedure.yaml").write_text("title: </pre><script>alert(3)</script>\n")
    page = report_of(run)
    assert not {"script", "img"} & set(page.tags)
    assert not page.values("onerror")
    assert not page.open
    assert all(name in page.text for name in names)
    assert "</pre><script>alert(3)</script>" in page.text


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (
            {"outcome": "ABORTED", "stop_after": 9},
            ("The run ended early: 9 of 12 planned points", "interrupted; the bench was brought to its safe state"),
        ),
        (
            {"outcome": "ERROR", "stop_after": 0, "without": ("models", "metrics", "residuals")},
            ("no point was measured", "no reply to 'TEMP?' within 1.0 s"),
        ),
        (
            {"outcome": "ERROR", "stop_after": 2, "without": ("models", "metrics", "residuals")},
            ("No model was fitted", "Points as measured, rates in °/s.", "nothing to set beside the published figures"),
        ),
        ({"without": ("timeline",)}, ("There is no timeline",)),
        ({"without": ("manifest",)}, ("no outcome recorded",)),
        ({"without": ("models",)}, (".json is missing: its figures are shown", "These residuals are held-out errors")),
        ({"without": ("models", "residuals")}, (".json cannot be used", "There is no compensated surface")),
        ({"without": ("residuals",)}, ("These residuals are of the model fitted on all points, so they are smaller",)),
        ({"outcome": "FAIL", "virtual": False}, ("Real bench.", "3 of 24 points failed their quality limits")),
        ({"rates_dps": (0,)}, ("Too few neighbouring points",)),
        ({"temperatures_degc": (20,)}, ("Too few neighbouring points",)),
    ],
)
def test_a_run_that_lacks_something_still_gives_a_report(
    tmp_path: Path, options: dict[str, object], words: tuple[str, ...]
) -> None:
    grid = {"duts": ("gyro-a",), "temperatures_degc": (-30, 0, 30), "rates_dps": (-180, -60, 60, 180)}
    run = write_synthetic_run(tmp_path / "r", **{**grid, **options})  # type: ignore[arg-type]
    page = report_of(run)
    assert [text for text in words if text not in page.text] == []
    assert not page.open


def test_a_run_that_measured_nothing_at_all_still_gives_a_report(tmp_path: Path) -> None:
    (tmp_path / "manifest.json").write_text("{}")
    page = report_of(tmp_path)
    assert "points.csv is missing" in page.text
    assert "svg" not in page.tags


def test_a_report_that_fails_leaves_the_old_one(tmp_path: Path) -> None:
    (tmp_path / "report.html").write_text("old")
    with pytest.raises(UserMistake, match="not a run folder"):
        write_report(tmp_path)
    assert (tmp_path / "report.html").read_text() == "old"
    assert len(list(tmp_path.iterdir())) == 1
