"""`dlokit call`: call one skill of a running system from any shell."""

import asyncio
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import tyro
from rich.console import Console

from dlokit.app.commands import CliCommand, flag
from dlokit.app.console import say
from dlokit.app.operate.skills import skill_named
from dlokit.app.shape.questions import TerminalOperator
from dlokit.communication import topics
from dlokit.communication.skill import ReportingSkill, Skill
from dlokit.communication.transport import Transport, first_message
from dlokit.decision.api import SHAPE_DLO
from dlokit.errors import EXIT_OTHERWISE, CommunicationError, InputError, StartNotConfirmed
from dlokit.recording.message_json import to_json
from dlokit.system.config import CONFIG_FILE, RunConfig
from dlokit.system.configuration.toml_config import read_toml
from dlokit.system.operator_start import RealStart, check_operator, state_of
from dlokit.system.processes.bus import JoinBus, calls_published, join_bus
from dlokit.system.processes.running import RunningSystem, the_running_system
from dlokit.system.rehearsal import Rehearsal, rehearsed
from dlokit.types.outcome import Failed, Outcome, Rejected, Succeeded
from dlokit.types.robot import RobotReason, RobotState

FOUND_WITHIN_S = 5.0
_BEATS_WITHIN_S = 0.5
"""Heartbeats of a commander come 25 times a second [s]."""


@dataclass(frozen=True, kw_only=True)
class CallArgs:
    """Call one skill of a running system, and print its outcome.

    Try
      dlokit call perception.look
      dlokit call decision.shape_dlo goal=S threshold_m=0.01
      dlokit call planning.set_strategy '{"spec": {"name": "rollout"}}'

      dlokit call robot.home --dry-run

    `dlokit skills` lists all skills. While a task commands a robot, motions called from here are rejected as
    not_commander, and another task is rejected as busy. Ctrl-C cancels the skill. Exit code: 0 succeeded, 3 ended
    otherwise, 2 bad input. Before a skill moves a real arm, questions in the terminal ask whether it may.
    """

    skill: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="COMPONENT.SKILL")]
    """The skill, with its component."""
    arguments: Annotated[tuple[str, ...], tyro.conf.Positional, tyro.conf.arg(metavar="NAME=VALUE")] = ()
    """Arguments of the skill: NAME=VALUE, the value as JSON or plain text; or one JSON object with all of them."""
    run: Annotated[Path | None, tyro.conf.arg(metavar="DIR")] = None
    """Folder of the run, needed when several systems run."""
    timeout: Annotated[float | None, flag("SECONDS")] = None
    """Cancel the skill after this time; the skill also has a time limit of its own."""
    dry_run: bool = False
    """Do not call the robot's skill: plan its motion from the arm's present state, check it with an arm in software,
    and print the result. Exit code 0: it would move now."""
    operator_confirms: bool = False
    """Move a real arm without questions: an operator has checked gripper, DLO and workspace, and has a hand on the
    emergency stop."""


def run_call(args: CallArgs) -> int:
    """Find the system, call the skill, print the outcome."""
    skill = skill_named(args.skill)
    given = arguments_from(skill, args.arguments)
    if args.dry_run:
        _check_rehearsable(skill)
    system = the_running_system(args.run)
    if args.dry_run:
        return _dry_run(system, skill, given)
    operator = operator_of(system, skill, confirms=args.operator_confirms)
    outcome = asyncio.run(call_skill(system, skill, given, args.timeout, Console(stderr=True), operator))
    print(outcome_line(outcome))
    return 0 if isinstance(outcome, Succeeded) else EXIT_OTHERWISE


def _config_of(system: RunningSystem) -> RunConfig:
    return read_toml(Path(system.folder) / CONFIG_FILE, RunConfig)


def operator_of(system: RunningSystem, skill: Skill[..., Any], *, confirms: bool) -> TerminalOperator | None:
    """The operator to ask before the skill moves a real arm; None if no real arm moves.

    Raises `ConfigError` without a terminal.
    """
    if not skill.moves_arm or not (config := _config_of(system)).moves_real_arm:
        return None
    check_operator(config, confirms=confirms)
    return TerminalOperator(confirms=confirms)


def _check_rehearsable(skill: Skill[..., Any]) -> None:
    """Raise `InputError` for a skill whose motion cannot be planned in advance."""
    if not skill.moves_arm:
        raise InputError(f"{skill.key} moves no arm: call it without --dry-run.")
    if skill.component == SHAPE_DLO.component:
        raise InputError(
            f"{skill.key} chooses each motion from the camera's view after the previous one: dlokit shape --dry-run "
            "plans and checks its first action."
        )


def _dry_run(system: RunningSystem, skill: Skill[..., Any], given: dict[str, Any]) -> int:
    """Print what the skill would do now, without a call to the running system."""
    config = _config_of(system)
    states, holder = asyncio.run(arms_now(system, config))
    done = rehearsed(config, states, skill, given)
    print(f"dry run: {rehearsal_line(skill, done)}")
    if holder:
        print(f"called now, it would be rejected as not_commander: {holder} commands the arm")
    return 0 if isinstance(done.outcome, Succeeded) and not holder else EXIT_OTHERWISE


def rehearsal_line(skill: Skill[..., Any], done: Rehearsal) -> str:
    """The result of a dry run in one line."""
    if not isinstance(done.outcome, Succeeded):
        return f"{skill.key} would not succeed: {outcome_line(done.outcome)}"
    place = ", ".join(f"{value:.3f}" for value in done.ends.T_world_tcp.position_m)
    return (
        f"{skill.key} passes all checks and takes {done.duration_s:.2f} s; the tool ends at ({place}) m, the fingers "
        f"{done.ends.finger_width_m * 1e3:.0f} mm apart; nothing has moved"
    )


async def arms_now(
    system: RunningSystem, config: RunConfig, join: JoinBus = join_bus
) -> tuple[dict[str, RobotState], str]:
    """The present state of each arm, and the name of the process that commands them; empty: no process."""
    async with join(system.bus, system.time_base) as bus:
        states = {mount.robot: await state_of(bus.transport, mount) for mount in config.mounts}
        beat = await first_message(bus.transport, topics.HEARTBEAT, _BEATS_WITHIN_S, with_last=False)
    return states, "" if beat is None else beat.holder


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
    if isinstance(outcome, Succeeded) and outcome.result is not None:
        return f"{outcome} {to_json(outcome.result).decode()}"
    return str(outcome)


def _json_or_text(text: str) -> Any:
    try:
        return json.loads(text)
    except json.JSONDecodeError:
        return text


async def call_skill(
    system: RunningSystem,
    skill: Skill[..., Any],
    given: dict[str, Any],
    limit_s: float | None,
    console: Console,
    operator: TerminalOperator | None = None,
    join: JoinBus = join_bus,
) -> Outcome[Any]:
    """Call a skill of a running system, and print its progress; cancel it after `limit_s`."""
    async with join(system.bus, system.time_base) as bus:
        await bus.first_tick()
        await bus.transport.wait_for(skill.component, FOUND_WITHIN_S)
        if operator is not None:
            try:
                await operator.confirm_motion(RealStart(bus.transport, _config_of(system)))
            except StartNotConfirmed as error:
                return Rejected(reason=RobotReason.NO_OPERATOR, detail=f"{error}; nothing was called")
        try:
            async with asyncio.timeout(limit_s):
                with calls_published(bus.transport, bus.clock):
                    return await _called(bus.transport, skill, given, console)
        except TimeoutError:
            return Failed(reason="cancelled", detail=f"it had not ended after {limit_s:g} s, the limit of --timeout")


async def _called(
    transport: Transport, skill: Skill[..., Any], given: dict[str, Any], console: Console
) -> Outcome[Any]:
    if not isinstance(skill, ReportingSkill):
        return await transport.call(skill, **given)

    def report(progress: object) -> None:
        say(console, to_json(progress).decode()[:200])

    return await transport.call_reported(skill, report, **given)


COMMAND = CliCommand(CallArgs, run_call)
