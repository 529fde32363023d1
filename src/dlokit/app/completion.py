"""`dlokit completion`: TAB completes commands, options and choices in your shell."""

from dataclasses import dataclass, make_dataclass
from functools import reduce
from operator import or_
from typing import Annotated, Any, Literal, NoReturn

import tyro

from dlokit.app.commands import OPTIONS, CliCommand, all_commands, groups, load, summary_of


@dataclass(frozen=True, kw_only=True)
class CompletionArgs:
    """Print a script with which TAB completes commands, options and choices in your shell.

    bash   eval "$(dlokit completion bash)", or once for all later shells:
           dlokit completion bash > ~/.local/share/bash-completion/completions/dlokit
    zsh    dlokit completion zsh > FOLDER/_dlokit, in a folder of your fpath
    fish   dlokit completion fish > ~/.config/fish/completions/dlokit.fish
    """

    shell: Annotated[Literal["bash", "zsh", "fish"], tyro.conf.Positional]
    """Your shell."""


def run(args: CompletionArgs) -> NoReturn:
    """Print the script and end the process."""
    tyro.cli(_every_command(), args=["--tyro-print-completion", args.shell], prog="dlokit", config=OPTIONS)
    raise AssertionError("tyro ends the process after printing the script")


def _every_command() -> Any:
    """The union type of all commands; unlike the list of commands, it imports all modules."""
    plain = [_subcommand(name, name) for name in all_commands() if " " not in name]
    return reduce(or_, [*plain, *(_group(group, about) for group, about in groups().items())])


def _group(group: str, about: str) -> Any:
    members = [_subcommand(name.split()[1], name) for name in all_commands() if name.startswith(f"{group} ")]
    return Annotated[reduce(or_, members), tyro.conf.subcommand(group, description=about)]


def _subcommand(word: str, name: str) -> Any:
    command = load(name)
    default = command.defaults([]) if command.defaults else tyro.MISSING_NONPROP
    arguments = command.arguments
    below = [_subcommand(longer.split()[1], longer) for longer in all_commands() if longer.startswith(f"{name} ")]
    if below:  # a command that has others below it, as `doctor` has `doctor franka`
        choice = reduce(or_, [*below, Annotated[None, tyro.conf.subcommand("", prefix_name=False)]])
        fields = [("below", Annotated[choice, tyro.conf.arg(name="")])]
        arguments = make_dataclass(arguments.__name__, fields, bases=(arguments,), frozen=True, kw_only=True)
    return Annotated[arguments, tyro.conf.subcommand(word, default=default, description=summary_of(name))]


COMMAND = CliCommand(CompletionArgs, run)
