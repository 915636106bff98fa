"""``ancf2d compile``: compile all kernels in advance."""

from __future__ import annotations

import time

import click

from .options import examples, plain_session
from .session import Bar, Session


@click.command(epilog=examples("ancf2d compile", "ancf2d compile -q"))
@plain_session
def command(session: Session) -> int:
    """Compile the kernels of all kinds of models in advance.

    This is optional: runs compile the kernels that they need and keep them. Use it for container images and classrooms,
    so that the first users need not wait. It does not compile the kernels of plugins; runs do.
    """
    from ..study.every_kernel import compile_everything

    started, bar = time.monotonic(), Bar("compiling", session.shows_progress)
    with bar:
        count, cache, refused = compile_everything(lambda done, what: bar.update(done, what))
    seconds = time.monotonic() - started
    if cache is None:
        session.warn(f"compiled, but not kept for later runs: {refused}")
        return 1
    session.out(f"compiled for {count} kinds of models in {seconds:.1f} s; kept in {cache}")
    return 0
