"""`dlokit call`: call one skill of a running system from any shell."""

import asyncio
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import tyro
from rich.console import Console

from dlokit.app.commands import CliCommand, flag
from dlokit.app.operate.skills import skill_named
from dlokit.communication.skill import ReportingSkill, Skill
from dlokit.communication.zenoh.transport import ZenohTransport
from dlokit.errors import EXIT_OTHERWISE, CommunicationError, InputError
from dlokit.recording.message_json import to_json
from dlokit.system.processes.bus import join_bus
from dlokit.system.processes.running import RunningSystem, the_running_system
from dlokit.system.results.recording import calls_published
from dlokit.types.outcome import Failed, Outcome, Rejected, Succeeded

FOUND_WITHIN_S = 5.0
FIRST_TICK_S = 10.0


@dataclass(frozen=True, kw_only=True)
class CallArgs:
    """Call one skill of a running system, and print its outcome.

    Try
      dlokit call perception.look
      dlokit call decision.shape_dlo goal=S threshold_m=0.01
      dlokit call planning.set_strategy '{"spec": {"name": "rollout"}}'

    `dlokit skills` lists all skills. While a task commands a robot, motions called from here are rejected as
    not_commander, and another task is rejected as busy. Ctrl-C cancels the skill. Exit code: 0 succeeded, 3 ended
    otherwise, 2 bad input.
    """

    skill: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="COMPONENT.SKILL")]
    """The skill, with its component."""
    arguments: Annotated[tuple[str, ...], tyro.conf.Positional, tyro.conf.arg(metavar="NAME=VALUE")] = ()
    """Arguments of the skill: NAME=VALUE, the value as JSON or plain text; or one JSON object with all of them."""
    run: Annotated[Path | None, tyro.conf.arg(metavar="DIR")] = None
    """Folder of the run, needed when several systems run."""
    timeout: Annotated[float | None, flag("SECONDS")] = None
    """Cancel the skill after this time; the skill also has a time limit of its own."""


def run_call(args: CallArgs) -> int:
    """Find the system, call the skill, print the outcome."""
    skill = skill_named(args.skill)
    given = arguments_from(skill, args.arguments)
    system = the_running_system(args.run)
    outcome = asyncio.run(_call(system, skill, given, args.timeout, Console(stderr=True)))
    print(outcome_line(outcome))
    return 0 if isinstance(outcome, Succeeded) else EXIT_OTHERWISE


def arguments_from(skill: Skill[..., Any], texts: tuple[str, ...]) -> dict[str, Any]:
    """Convert the typed arguments to the types of the skill. Raises `InputError`."""
    plain: dict[str, Any] = {}
    for text in texts:
        name, equals, value = text.partition("=")
        if text.startswith("{"):
            whole = _json_or_text(text)
            if not isinstance(whole, dict):
                raise InputError(f'{text} is not a JSON object: write {{"name": value}}, or name=value.')
            plain.update(whole)
        elif equals:
            plain[name] = _json_or_text(value)
        else:
            raise InputError(f"{text!r} is not an argument: write name=value, or one JSON object with all of them.")
    try:
        return skill.plain_arguments(plain)
    except CommunicationError as error:
        raise InputError(str(error)) from error


def outcome_line(outcome: Outcome[Any]) -> str:
    """An outcome as one line of text; the result as JSON."""
    match outcome:
        case Succeeded(result=result):
            return "succeeded" if result is None else f"succeeded {to_json(result).decode()}"
        case Failed(reason=reason, detail=detail):
            return f"failed {reason}: {detail}"
        case Rejected(reason=reason, detail=detail):
            return f"rejected {reason}: {detail}"
        case _:
            return " ".join((type(outcome).__name__.lower(), to_json(outcome).decode()))


def _json_or_text(text: str) -> Any:
    try:
        return json.loads(text)
    except json.JSONDecodeError:
        return text


async def _call(
    system: RunningSystem, skill: Skill[..., Any], given: dict[str, Any], limit_s: float | None, console: Console
) -> Outcome[Any]:
    async with join_bus(system.bus, system.time_base) as bus:
        await bus.first_tick(FIRST_TICK_S)
        await bus.transport.wait_for(skill.component, FOUND_WITHIN_S)
        try:
            async with asyncio.timeout(limit_s):
                with calls_published(bus.transport, bus.clock):
                    return await _called(bus.transport, skill, given, console)
        except TimeoutError:
            return Failed(reason="cancelled", detail=f"it had not ended after {limit_s:g} s, the limit of --timeout")


async def _called(
    transport: ZenohTransport, skill: Skill[..., Any], given: dict[str, Any], console: Console
) -> Outcome[Any]:
    if not isinstance(skill, ReportingSkill):
        return await transport.call(skill, **given)

    def report(progress: object) -> None:
        console.print(to_json(progress).decode()[:200], markup=False, highlight=False, soft_wrap=True)

    return await transport.call_reported(skill, report, **given)


COMMAND = CliCommand(CallArgs, run_call)
