"""Options that several commands share."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

import click

from .session import Session

F = TypeVar("F", bound=Callable[..., Any])


def _switch(*names: str, attribute: str, help: str) -> Callable[[F], F]:
    """Return a flag that is noted in the session before anything else can fail."""
    def noted(ctx: click.Context, parameter: click.Parameter, value: bool) -> None:
        session = ctx.find_object(Session)
        if value and session is not None:
            setattr(session, attribute, True)
    return click.option(*names, is_flag=True, is_eager=True, expose_value=False, callback=noted, help=help)


debug_option = _switch("--debug", attribute="debug", help="Show the Python traceback of a failure.")
json_option = _switch("--json", attribute="json", help="Print one JSON object on stdout, also on failure.")
quiet_option = _switch("-q", "--quiet", attribute="quiet", help="Print errors only.")
verbose_option = _switch("-v", "--verbose", attribute="verbose", help="Say what was built and what was left out.")

case_argument = click.argument("case", type=click.Path(), metavar="CASE")
set_option = click.option("--set", "overrides", multiple=True, metavar="PATH=VALUE",
                          help="Override a value of the case, e.g. bodies.beam.element.count=32 or "
                               "loads.0.value=[0,-500]; may be given several times.")
force_option = click.option("--force", is_flag=True, help="Replace a file that ancf2d did not write.")
