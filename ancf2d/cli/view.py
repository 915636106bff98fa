"""``ancf2d view``: show results on an interactive page."""

from __future__ import annotations

import click

from .options import examples, force_option, plain_session
from .session import Session


@click.command(epilog=examples("ancf2d view swing.h5", "ancf2d view swing.h5 --save swing.html"))
@click.argument("file", type=click.Path(), metavar="OUT.h5")
@click.option("-o", "--save", type=click.Path(), metavar="PAGE.html", help="Write the page to a single "
              "self-contained file instead of serving it.")
@click.option("--field", "fields", multiple=True, metavar="NAME", help="Field to show as colour: stress, strain, "
              "energy, N, Q or M, computed from the states if it is not stored; may be given several times. [default: "
              "the stored fields]")
@click.option("--port", type=click.IntRange(0, 65535), default=0, metavar="N",
              help="Port on this machine; default: a free one.")
@click.option("--no-browser", is_flag=True, help="Only print the address; do not open a browser.")
@force_option
@plain_session
def command(session: Session, file: str, save: str | None, fields: tuple[str, ...], port: int, no_browser: bool,
            force: bool) -> int:
    """Show a result in the browser: bodies in motion, fields, modes, probes.

    The page needs no network. Long runs are thinned to keep it below 5 MB; the result file does not change.
    """
    from ..results import open_results
    from ..results.target import PAGE, check_output, replacing
    from ..study.fields_of_states import StatesWithFields
    from ..view import make_page, serve

    check_output(save, force, file, kind=PAGE)
    with StatesWithFields(file) if fields else open_results(file) as results:
        page = make_page(results, fields=fields)
    if save is not None:
        content = page.html.encode()
        with replacing(save, force) as private:
            private.write_bytes(content)
        size = f"{len(content) / 1e6:.1f} MB" if len(content) >= 1e6 else f"{len(content) / 1e3:.0f} kB"
        session.out(f"wrote {save} ({size}; {page.remark})")
        return 0

    def ready(address: str) -> None:
        session.out(f"{file} is served at {address} until Ctrl-C ({page.remark})")
        if not no_browser:
            import webbrowser

            webbrowser.open(address)

    serve(page.html, port, ready)
    return 0
