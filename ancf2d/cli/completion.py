"""``ancf2d completion``: shell code that completes commands and options."""

from __future__ import annotations

import click
from click.shell_completion import get_completion_class

from .options import debug_option, examples, quiet_option
from .session import Session
from .text import write

SHELLS = ("bash", "zsh", "fish")
# environment variable by which the shell asks for completions; click derives it from the program's name
VARIABLE = "_ANCF2D_COMPLETE"


@click.command(epilog=examples("ancf2d completion bash >> ~/.bashrc", "ancf2d completion zsh >> ~/.zshrc",
                               "ancf2d completion fish > ~/.config/fish/completions/ancf2d.fish"))
@click.argument("shell", type=click.Choice(SHELLS), metavar="SHELL")
@quiet_option
@debug_option
@click.pass_context
def command(context: click.Context, shell: str) -> int:
    """Print the shell code that completes commands, options, element types and files.

    SHELL is bash (4.4 or newer), zsh or fish. Append the output to the start file of the shell.
    """
    found = get_completion_class(shell)
    assert found is not None, "click knows the shells that are offered"
    session = context.find_object(Session)
    assert session is not None, "every invocation has one"
    write(found(context.find_root().command, {}, "ancf2d", VARIABLE).source() + "\n")
    return 0
