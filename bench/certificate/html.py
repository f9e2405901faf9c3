"""The certificate as one HTML page without scripts, printable on A4."""

from __future__ import annotations

from bench.certificate.content import Page


def html(page: Page) -> str:
    """The page; the same content gives the same text."""
    import jinja2

    made = jinja2.Environment(
        loader=jinja2.PackageLoader("bench.certificate"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return made.get_template("certificate.html.j2").render(page=page)
