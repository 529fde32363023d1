"""`dlokit track`: follow a DLO in recorded clouds, or in the pictures of a camera."""

import asyncio
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro
from msgspec import Meta
from rich.console import Console
from rich.table import Table

from dlokit.app.commands import CliCommand, flag, value_of
from dlokit.app.console import compile_progress, say
from dlokit.app.data.cloud_files import read_camera_pose, read_clouds, read_nodes
from dlokit.app.data.cloud_track import TrackResult, TrackSettings, distrust_of, track_clouds, write_result
from dlokit.app.library.tracker import in_world
from dlokit.communication.memory import MemoryTransport
from dlokit.communication.transport import Transport
from dlokit.errors import EXIT_FAULT, InputError, require_cell
from dlokit.functional.cameras.base import Camera
from dlokit.functional.cameras.calibration_file import check_has_pose, read_calibration
from dlokit.functional.cameras.recorded import RecordedCameraConfig
from dlokit.functional.cameras.strategies import CAMERAS, AnyCamera
from dlokit.ranges import NotNegative, Positive, check_ranges
from dlokit.recording.channels import in_order
from dlokit.rod.believed import BelievedDlo
from dlokit.skills.observer.config import OBSERVERS
from dlokit.skills.perception.brightness import BrightnessConfig
from dlokit.skills.perception.config import SEGMENTATIONS, AnySegmentation, BoxConfig, CloudConfig
from dlokit.skills.viewer.config import ViewerConfig
from dlokit.system.build import placed_camera
from dlokit.system.config import Ros2Config, RunConfig, one_of
from dlokit.system.configuration.installation_file import with_installation
from dlokit.system.results.run_folder import claim_run_folder, run_folder
from dlokit.system.table import trackers_of_run

Corner = tuple[float, float, float]

LONGEST_TABLE = 20
"""Of more clouds than fit a terminal, the table has those that were not followed."""


@dataclass(frozen=True, kw_only=True)
class TrackArgs:
    """Track the nodes of a DLO through recorded point clouds, or live in the pictures of a camera, without a robot.

    Try
      dlokit track cloud_0.pcd cloud_1.pcd --initial nodes.csv        recorded clouds; writes nodes and a plot
      dlokit track cloud_*.ply --T-world-camera calibration.toml      recorded clouds in the frame of a camera
      dlokit track --camera recorded --camera.path runs/<run>         recorded pictures, in the viewer
      dlokit track --camera realsense --segmentation colour           a RealSense camera, until Ctrl-C

    Clouds are in the world's frame unless --T-world-camera is given, and show the DLO alone; the nodes and the box are
    in the world. With a camera that is the world of its calibration. Adapt the segmentation to your DLO:
    `dlokit track --camera realsense --segmentation colour --help` shows its settings.

    The table's "points to line" is the root mean square distance of the cloud's points from the line through the nodes:
    noise and thickness of the DLO, not an error of the nodes, which may also slide along the line.
    Health does not notice that either, nor that cpd, spr and som draw a hidden end onto the visible part; from 15 % of
    lost length on, the issue is "shortened".

    Exit code: 0 a cloud or picture was followed; 1 none was; 2 invalid input.
    """

    clouds: Annotated[tuple[Path, ...], tyro.conf.Positional] = ()
    """Clouds in chronological order: .pcd, .ply, .npy or .csv files of points [m]; those of a shell's * are taken
    by the numbers in their names. A .npy file may hold several, (T, N, 3). Omit them with --camera."""
    T_world_camera: Annotated[Path | None, flag("FILE", "clouds are in the world")] = None
    """The camera's pose, if the clouds are in its frame (x right, y down, z forward): its calibration (.toml), or a
    matrix (4, 4) with p_world = T_world_camera p_camera (.npy, .csv, .txt)."""
    camera: Annotated[str | None, one_of(CAMERAS, "none: recorded clouds")] = None
    """Camera whose pictures are followed: recorded, realsense, or another installed one."""
    installation: Annotated[Path | None, flag("FILE")] = None
    """Follow the camera of this installation file; nodes are in its world, on its table. --camera chooses another."""
    segmentation: Annotated[str | None, one_of(SEGMENTATIONS, BrightnessConfig.name)] = None
    """How DLO pixels are found in the pictures of a camera: brightness or colour, or another installed one."""
    initial: Annotated[Path | None, flag("FILE")] = None
    """Nodes (M, 3) [m] at the first cloud, .npy or .csv; the DLO may be branched. A file of several clouds, as this
    command writes it: the last cloud's nodes. Without this file the first cloud is ordered into one chain."""
    out: Path | None = None
    """Folder for nodes.npy, nodes.csv, edges.csv and track.png; default: runs/<time>-track. With a camera it gets
    nodes.csv alone, and without it nothing is written."""
    nodes: Annotated[int, Meta(ge=3)] = BelievedDlo.nodes
    """Number of nodes M, if --initial is not given."""
    length_m: float | None = None
    """Length of the DLO [m], if --initial is not given; default: the length of the first cloud, which is less
    accurate."""
    radius_m: Annotated[float, Meta(ge=1e-4, le=1.0)] | None = None
    """Radius of the DLO [m]; default: 0.004, or that of a thicker DLO where the first cloud shows one."""
    observer: str = "map"
    """Observer strategy: map, anchored, cpd, spr, som, or another installed one."""
    box_lower: Corner | None = None
    """Corner of the box filter with the smallest coordinates [m]; without it, no box is applied."""
    box_upper: Corner | None = None
    """Corner of the box filter with the largest coordinates [m]."""
    voxel_m: NotNegative = CloudConfig.voxel_m
    """Side of the cubes that each keep the mean of their points [m]; isolated points are omitted then. 0 keeps all
    points."""
    rate_hz: Annotated[float, Meta(gt=0.0, le=1000.0)] = 30.0
    """Pictures of a camera per second, at most."""
    duration_s: Positive | None = None
    """Time after which a camera is no longer followed [s]; without it, until Ctrl-C."""
    headless: bool = False
    """Follow a camera without the browser viewer."""
    port: int = ViewerConfig.port
    """TCP port of the viewer's page; 0 takes any free one."""
    camera_settings: Annotated[AnyCamera, tyro.conf.arg(name="camera")] = field(default_factory=RecordedCameraConfig)
    """Settings of the camera."""
    segmentation_settings: Annotated[AnySegmentation, tyro.conf.arg(name="segmentation")] = field(
        default_factory=BrightnessConfig
    )
    """Settings of the segmentation."""
    ros2: bool = False
    """Publish the nodes of a camera's pictures in ROS 2; docs/how-to/use-from-ros2.md."""
    ros2_settings: Annotated[Ros2Config, tyro.conf.arg(name="ros2")] = field(default_factory=Ros2Config)
    """The connection to ROS 2."""


def _defaults(arguments: Sequence[str]) -> TrackArgs:
    """The settings of the camera and the segmentation that the command line names."""
    args = TrackArgs()
    if (file := value_of(arguments, "--installation")) is not None:
        args = replace(args, camera_settings=with_installation(RunConfig(), Path(file)).camera)
    if (name := value_of(arguments, "--camera")) is not None:
        wanted = CAMERAS.named(name, "--camera")
        if type(args.camera_settings) is not wanted:
            args = replace(args, camera_settings=wanted())
    if (name := value_of(arguments, "--segmentation")) is not None:
        args = replace(args, segmentation_settings=SEGMENTATIONS.named(name, "--segmentation")())
    return args


def run(args: TrackArgs) -> int:
    """Execute the command; returns 0, or 1 where no cloud was followed, or raises `InputError`."""
    settings = _settings(args)
    if args.camera is not None or args.installation is not None:
        return _run_live(args, settings)
    named = [cloud for path in chronological(args.clouds) for cloud in read_clouds(path)]
    names, clouds = [name for name, _ in named], [points for _, points in named]
    if args.T_world_camera is not None:
        T_world_camera = read_camera_pose(args.T_world_camera)
        clouds = [in_world(points, T_world_camera) for points in clouds]
    initial = None if args.initial is None else read_nodes(args.initial)
    _load(settings)
    result = track_clouds(clouds, initial, settings, names=names)
    out = run_folder(args.out, "track")
    names = [Path(name).name for name in names]
    write_result(result, names, out)
    _print(result, names, out)
    return 0 if any(nodes.distrust is None for nodes in result.nodes) else EXIT_FAULT


def _load(settings: TrackSettings) -> None:
    """Load the observer, and show the progress where it is compiled first."""
    from dlokit.skills.observer.kernels import load_kernels

    with compile_progress(Console(), "the observer"):
        load_kernels((settings.observer,))


def chronological(clouds: Sequence[Path]) -> Sequence[Path]:
    """The clouds as given; those of one folder in a shell's order, 1, 10, 2, by the numbers in their names."""
    by_shell = list(clouds) == sorted(clouds) and len({path.parent for path in clouds}) == 1
    return in_order(clouds) if by_shell else clouds


def _run_live(args: TrackArgs, settings: TrackSettings) -> int:
    """Follow a camera until it ends or Ctrl-C, and print how that went; returns 0, or 1 where nothing was followed."""
    run = _run_of(args)
    transport = MemoryTransport()  # no cell: no process serves this bus
    camera = _camera(args, run, transport)
    # The pictures need libraries that clouds do not.
    require_cell(f"dlokit track --camera {run.camera.name}")
    from dlokit.app.data import live_track

    live = live_track.LiveSettings(segmentation=args.segmentation_settings, **vars(settings))
    path = None if args.out is None else claim_run_folder(args.out) / "nodes.csv"
    summary, tracker = live_track.LiveSummary(), live_track.LiveTracker(live, run.installation.fixtures)
    output = partial(say, Console())

    _load(settings)
    pace = live_track.FollowPace(rate_hz=args.rate_hz, duration_s=args.duration_s)
    try:
        with live_track.nodes_file(path) as write:
            following = live_track.follow_in_system(
                camera, tracker, write, output, summary, run=run, pace=pace, transport=transport
            )
            asyncio.run(following)
    except KeyboardInterrupt:
        output("ended by Ctrl-C")
    for line in summary.lines():
        output(line)
    return 0 if summary.followed else EXIT_FAULT


def _run_of(args: TrackArgs) -> RunConfig:
    """The configuration of a run without a robot."""
    run = RunConfig() if args.installation is None else with_installation(RunConfig(), args.installation)
    return replace(
        run,
        camera=args.camera_settings,
        headless=args.headless,
        viewer=replace(run.viewer, port=args.port),
        model=replace(run.model, nodes=args.nodes, radius_m=args.radius_m or BelievedDlo.radius_m),
        ros2=replace(args.ros2_settings, publish=args.ros2),
    )


def _camera(args: TrackArgs, run: RunConfig, transport: Transport) -> Camera:
    config = run.camera
    if args.clouds or args.initial is not None or args.T_world_camera is not None:
        asked = f"--camera {args.camera}" if args.camera else "--installation"
        raise InputError(
            f"{asked} follows pictures: omit the clouds, --initial and --T-world-camera, or omit {asked}; "
            "for clouds in the frame of a camera --T-world-camera gives its pose"
        )
    if config.sees_cell:
        real = ", ".join(name for name, of in CAMERAS.installed().items() if not of.sees_cell)
        raise InputError(
            f"--camera {config.name} sees the simulated cell, which runs in `dlokit shape --camera {config.name}`; "
            f"`dlokit track` takes {real}"
        )
    if run.calibration:
        check_has_pose(run.calibration, read_calibration(Path(run.calibration)))
    for row in trackers_of_run(run):
        row.check(run)
    return placed_camera(run, config.build(transport))


def _settings(args: TrackArgs) -> TrackSettings:
    observer = OBSERVERS.named(args.observer, "--observer")
    if args.length_m is not None and not 0.01 <= args.length_m <= 100.0:
        raise InputError(f"--length-m is {args.length_m}; it must be 0.01 to 100 metres")
    check_ranges(args)
    if (args.box_lower is None) != (args.box_upper is None):
        raise InputError("--box-lower and --box-upper go together: give both corners, or neither")
    box = None
    if args.box_lower is not None and args.box_upper is not None:
        try:
            box = BoxConfig(lower_world=args.box_lower, upper_world=args.box_upper)
        except ValueError as error:
            raise InputError(str(error)) from error
    return TrackSettings(
        observer=observer(),
        nodes=args.nodes,
        length_m=args.length_m,
        radius_m=args.radius_m,
        box=box,
        voxel_m=args.voxel_m,
    )


def _print(result: TrackResult, clouds: Sequence[str], out: Path) -> None:
    console = Console()
    table = Table("cloud", "points", "visible", "health", "points to line, mm", "time, ms", "issue")
    for number, (name, nodes) in enumerate(zip(clouds, result.nodes, strict=True)):
        if nodes.distrust is None and len(clouds) > LONGEST_TABLE:
            continue
        table.add_row(
            name,
            str(len(result.clouds[number])),
            f"{np.count_nonzero(nodes.visible)}/{len(nodes.visible)}",
            f"{nodes.health:.2f}",
            f"{result.distance_m[number] * 1000:.1f}",
            f"{result.seconds[number] * 1000:.0f}",
            distrust_of(nodes),
        )
    if table.rows:
        console.print(table)
    visible = [np.count_nonzero(nodes.visible) for nodes in result.nodes]
    health = [nodes.health for nodes in result.nodes]
    say(
        console,
        f"visible {min(visible)} to {max(visible)} of {result.nodes_world.shape[1]} nodes; health {min(health):.2f} to "
        f"{max(health):.2f}; median time {np.median(result.seconds) * 1000:.0f} ms a cloud",
    )
    say(console, f"nodes.npy, nodes.csv, edges.csv and track.png in {out}")
    reasons = Counter(map(distrust_of, result.nodes))
    summary = f"{reasons.pop('', 0)} of {len(clouds)} clouds followed"
    others = ", ".join(f"{reason} ({count})" for reason, count in reasons.items())
    say(console, f"{summary}; not followed: {others}" if others else summary)


COMMAND = CliCommand(TrackArgs, run, _defaults)
