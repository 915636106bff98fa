"""The command ``ancf2d``: its commands, imported only when called, and the exit of every invocation."""

from __future__ import annotations

import logging
import sys
import warnings
from collections.abc import Sequence
from contextlib import suppress
from importlib import import_module
from typing import Any

import click

from .. import __version__
from ..interrupts import patient_interrupts, uninterrupted
from .failures import FAILED, explain
from .options import debug_option, plugin_option
from .session import Session

# the list of commands: NAME is the function ``command`` in cli/NAME.py
COMMANDS = {
    "new": "Write a commented case to start from.",
    "validate": "Check cases without solving.",
    "run": "Solve a case and write a result file.",
    "convergence": "Refine the mesh: errors, observed orders, limits.",
    "tradeoff": "Measure error against cost; recommend settings.",
    "sensitivity": "Differentiate the goal with respect to numbers of a case.",
    "optimise": "Find the best values of some numbers of a case.",
    "sweep": "Run many variants of one case; print one table.",
    "fit": "Fit numbers of a case to measured data.",
    "plot": "Draw result files.",
    "view": "Show a result in the browser.",
    "info": "Describe the contents and origin of a result file.",
    "compare": "Compare the numbers in two result files.",
    "export": "Write results in other formats: ParaView, CSV, JSON.",
    "elements": "List element types and formulations.",
    "audit": "Examine an element type, listed or your own.",
    "schema": "Print the JSON Schema of case files, for editors.",
    "compile": "Compile all kernels in advance.",
    "completion": "Print the shell code that completes commands and options.",
}
# commands that read cases (also from results) or element types, and therefore load plugins
EXTENSIBLE = ("validate", "run", "convergence", "tradeoff", "sensitivity", "optimise", "sweep", "fit", "plot",
              "elements", "audit", "schema")


class App(click.Group):
    """A group that imports its commands when they are called, and explains failures."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the names of all commands, in the order of typical use."""
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Return a command after importing it."""
        if cmd_name not in COMMANDS:
            return None
        command: click.Command = import_module(f"{__package__}.{cmd_name}").command
        command.short_help = COMMANDS[cmd_name]
        if cmd_name in EXTENSIBLE and command.params[-1].name != "plugin":
            command.params.append(plugin_option())
        return command

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the list of commands without importing them."""
        with formatter.section("Commands"):
            formatter.write_dl(list(COMMANDS.items()))

    def resolve_command(self, ctx: click.Context, args: list[str],
                        ) -> tuple[str | None, click.Command | None, list[str]]:
        """Return the command; for an unknown name, fail with the nearest one."""
        if args and not args[0].startswith("-") and args[0] not in COMMANDS:
            from difflib import get_close_matches

            near = get_close_matches(args[0], COMMANDS, 1)
            hint = f"did you mean '{near[0]}'?" if near else f"there are {', '.join(COMMANDS)}"
            ctx.fail(f"no such command '{args[0]}'; {hint}")
        return super().resolve_command(ctx, args)

    def main(self, args: Sequence[str] | None = None, prog_name: str | None = None, complete_var: str | None = None,
             standalone_mode: bool = True, **extra: Any) -> Any:
        """Run the command line and exit: 0 done, 1 failed, 2 wrong input, 130 interrupted."""
        session = Session(list(sys.argv[1:] if args is None else args))
        _survive_any_title()
        try:
            with warnings.catch_warnings(), patient_interrupts():
                if not (sys.warnoptions or "--debug" in session.arguments):
                    warnings.simplefilter("ignore")
                    # hides its messages on building a font cache
                    logging.getLogger("matplotlib").setLevel(logging.ERROR)
                code = super().main(args, prog_name or "ancf2d", complete_var, standalone_mode=False, obj=session,
                                    **extra)
        except (Exception, KeyboardInterrupt) as error:
            with suppress(KeyboardInterrupt), uninterrupted():  # a second interruption adds nothing
                code = _explain(error, session)
        except SystemExit:
            # raised only by click when the reader of the help has closed the pipe: not a failure
            code = 0
        sys.exit(code if isinstance(code, int) else 0)


def _explain(error: BaseException, session: Session) -> int:
    """Explain a failure; return the exit code even if nothing can be printed."""
    try:
        return explain(error, session)
    except OSError:
        return FAILED


def _survive_any_title() -> None:
    """Make stdout and stderr print escapes for characters that their encoding lacks."""
    for stream in (sys.stdout, sys.stderr):
        with suppress(AttributeError, ValueError, OSError):
            stream.reconfigure(errors="backslashreplace")  # type: ignore[union-attr]


@click.group("ancf2d", cls=App, context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
             epilog="'ancf2d COMMAND --help' says more, with examples. Start with 'ancf2d new beam', then 'ancf2d run "
                    "beam.yaml'.")
@click.version_option(__version__, prog_name="ancf2d")
@debug_option
def app() -> None:
    """Planar flexible multibody dynamics with ANCF and geometrically exact beams, from YAML case files.

    Results go to stdout, everything else to stderr. Exit codes: 0 done, 1 the computation failed, 2 the
    command line, the case or an input file is wrong, 130 interrupted.
    """
