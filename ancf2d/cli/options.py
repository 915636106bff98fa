"""Options shared by several commands."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from contextlib import suppress
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click
from click.shell_completion import CompletionItem

from .session import Session

if TYPE_CHECKING:
    from ..case import LoadedCase
    from ..study.pool import Workers

F = TypeVar("F", bound=Callable[..., Any])
ADDRESS = re.compile(r"((tcp|tls|ucx|ws|wss)://)?[^/\s]+:\d+")


def _switch(*names: str, attribute: str, help: str) -> Callable[[F], F]:
    """Return a flag option that is stored in the session before anything else can fail."""
    def noted(ctx: click.Context, parameter: click.Parameter, value: bool) -> None:
        session = ctx.find_object(Session)
        if value and session is not None:
            setattr(session, attribute, True)
    return click.option(*names, is_flag=True, is_eager=True, expose_value=False, callback=noted, help=help)


def examples(*lines: str) -> str:
    """Return command lines in the form shown at the end of a command's help, each on its own line."""
    # click does not rewrap the lines after \\b
    return "\n".join(["\b", "Examples:", *(f"  {line}" for line in lines)])


debug_option = _switch("--debug", attribute="debug", help="Show the Python traceback of a failure.")
json_option = _switch("--json", attribute="json", help="Print one JSON object on stdout, even if the command fails.")
quiet_option = _switch("-q", "--quiet", attribute="quiet", help="Print errors only.")
verbose_option = _switch("-v", "--verbose", attribute="verbose", help="Describe the model, and anything left out.")


def plain_session(command: F) -> F:
    """Pass the session to a command, and add the options --quiet and --debug."""
    return quiet_option(debug_option(click.pass_obj(command)))  # type: ignore[return-value]


def json_session(command: F) -> F:
    """Pass the session to a command, and add the options --json, --quiet and --debug."""
    return json_option(plain_session(command))


def _load_plugin(ctx: click.Context, parameter: click.Parameter, paths: tuple[str, ...]) -> None:
    from ..extend.plugins import add_plugin, load_plugins

    for path in paths:
        add_plugin(path)
    load_plugins()


def plugin_option() -> click.Option:
    """Return the option that loads plugins, which is processed before a case is read."""
    return click.Option(["--plugin"], multiple=True, metavar="FILE.py", is_eager=True, expose_value=False,
                        callback=_load_plugin, type=click.Path(),
                        help="Load springs, loads or formulations of your own from a Python file; may be given several "
                             "times.")


def complete_types(ctx: click.Context, parameter: click.Parameter, incomplete: str) -> list[CompletionItem]:
    """Return the element types that can complete a comma-separated list, or else files."""
    from ..elements import registry

    before, _, begun = incomplete.rpartition(",")
    start = f"{before}," if before else ""
    names = [name for name in registry.ELEMENTS if name.startswith(begun)]
    return [CompletionItem(start + name) for name in names] or [CompletionItem(incomplete, type="file")]


def complete_kinds(ctx: click.Context, parameter: click.Parameter, incomplete: str) -> list[CompletionItem]:
    """Return the kinds of figure as completions after the first file, or else files."""
    names: list[str] = []
    if ctx.params.get(parameter.name or ""):
        from ..plot import KINDS

        names = [name for name in KINDS if name.startswith(incomplete)]
    return [CompletionItem(name) for name in names] or [CompletionItem(incomplete, type="file")]


def _case_name(ctx: click.Context, parameter: click.Parameter, value: Any) -> Any:
    """Return the name of a case, or of several, with ``-`` replaced by the name of stdin."""
    if isinstance(value, tuple):
        return tuple(_case_name(ctx, parameter, one) for one in value)
    from ..case.compose import STDIN

    return STDIN if value == "-" else value


def read_case(case: str, overrides: Sequence[str], output: str | None, force: bool) -> LoadedCase:
    """Return a loaded case after checking that its results may be written to ``output``.

    Raises CaseError, and ResultsError if ``output`` is a file that must not be replaced.
    """
    from ..results.target import RESULTS, check_output
    from ..study.digests import inputs_of
    from ..study.run import load

    loaded = load(case, overrides)
    check_output(output, force, *inputs_of(loaded), kind=RESULTS)
    return loaded


def either(dts: tuple[float, ...] | None, tolerances: tuple[float, ...] | None) -> tuple[str, tuple[float, ...]]:
    """Return which of --dt and --tolerance is given, with its values, or empty ones. Raises UsageError for both."""
    if dts and tolerances:
        raise click.UsageError("--dt and --tolerance are both given; give only one.")
    return ("dt", dts) if dts else ("tolerance", tolerances) if tolerances else ("", ())


def case_stem(case: str) -> str:
    """Return the default stem of the names of files made from a case."""
    from ..case.compose import STDIN

    return "stdin" if case == STDIN else Path(case).stem


case_argument = click.argument("case", type=click.Path(), metavar="CASE", callback=_case_name)
cases_argument = click.argument("cases", nargs=-1, required=True, type=click.Path(), metavar="CASE...",
                                callback=_case_name)
set_option = click.option("--set", "overrides", multiple=True, metavar="PATH=VALUE",
                          help="Override a value of the case, e.g. bodies.beam.element.count=32 or "
                               "loads.0.value=[0,-500]; loads.0.at=0.5 moves a point BODY@S along its body, PATH+=ITEM "
                               "appends to a list, PATH=null removes a key or an item. May be given several times.")
vary_option = click.option("--vary", multiple=True, required=True, metavar="PATH=LOW:HIGH",
                           help="A number of the case and its bounds. May be given several times. The search starts "
                           "from the values of the case.")
force_option = click.option("--force", is_flag=True, help="Replace a file that ancf2d did not write.")
scheduler_option = click.option("--scheduler", metavar="ADDRESS", help="Run on the Dask cluster of this scheduler, "
                                "e.g. tcp://127.0.0.1:8786, instead of in processes on this machine.")


def parsed(read: Callable[[str], Any], accepts: Callable[[Any], bool], otherwise: str) -> Callable[..., Any]:
    """Return the callback of an option whose text is ``read``; it refuses any other text.

    ``otherwise`` says what such a text is not, and what is expected.
    """
    def callback(ctx: click.Context, parameter: click.Parameter, text: str | None) -> Any:
        if text is None:
            return None
        with suppress(ValueError):
            found = read(text)
            if accepts(found):
                return found
        raise click.BadParameter(f"'{text}' is {otherwise}.")
    return callback


def whole_numbers(text: str) -> list[int]:
    """Return the whole numbers in a list with commas. Raises ValueError."""
    return [int(part) for part in text.split(",")]


def jobs_option(what: str, default: str) -> Callable[[F], F]:
    """Return the option for the number of processes; ``default`` is the help text for the default of ``workers``."""
    return click.option("--jobs", type=click.IntRange(min=1), metavar="N", help=f"{what} Default: {default}.")


def workers(jobs: int | None, scheduler: str | None, default: int | None = None) -> Workers:
    """Return the workers requested by --jobs and --scheduler; by default one process per core."""
    from ..processors import cores
    from ..study.pool import Workers

    if scheduler is None:
        return Workers(jobs or default or cores())
    if jobs is not None:
        raise click.UsageError("--jobs is for processes on this machine; with --scheduler, as many jobs run as the "
                               "cluster has workers.")
    if not ADDRESS.fullmatch(scheduler):
        raise click.UsageError(f"'{scheduler}' is not the address of a scheduler; expected for example "
                               "tcp://127.0.0.1:8786.")
    if find_spec("distributed") is None:
        raise click.UsageError("--scheduler needs Dask: pip install 'ancf2d[cluster]'.")
    return Workers(scheduler=scheduler)
