"""`dlokit track`: follow a DLO in recorded clouds, or in the pictures of a camera."""

import asyncio
import csv
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from msgspec import Meta
from rich.console import Console
from rich.table import Table

from dlokit.app.commands import CliCommand, flag, one_of
from dlokit.app.console import say
from dlokit.app.data.cloud_files import read_cloud, read_nodes
from dlokit.app.library.plots import draw_nodes
from dlokit.app.library.tracker import Nodes, Tracker
from dlokit.app.shape.job import value_of
from dlokit.communication.memory import MemoryTransport
from dlokit.errors import EXIT_FAULT, InputError, require_cell
from dlokit.functional.cameras.base import Camera
from dlokit.functional.cameras.calibration_file import check_has_pose, read_calibration
from dlokit.functional.cameras.recorded import RecordedCameraConfig
from dlokit.functional.cameras.strategies import CAMERAS, AnyCamera
from dlokit.ranges import NotNegative, Positive, check_ranges
from dlokit.recording.channels import in_order
from dlokit.rod.believed import BelievedDlo
from dlokit.skills.observer.base import ObserverStrategyConfig
from dlokit.skills.observer.strategies import OBSERVERS
from dlokit.skills.observer.visibility import distance_to_dlo_m
from dlokit.skills.perception.brightness import BrightnessConfig
from dlokit.skills.perception.cloud import inside_box, lonely, thin
from dlokit.skills.perception.config import BoxConfig, CloudConfig
from dlokit.skills.perception.segmentations import SEGMENTATIONS, AnySegmentation
from dlokit.skills.viewer.config import ViewerConfig
from dlokit.system.build import placed_camera
from dlokit.system.config import RunConfig
from dlokit.system.installation_file import with_installation
from dlokit.system.results.run_folder import claim_run_folder, run_folder
from dlokit.types.arrays import Float64Array

MOST_PANELS = 12
NODE_COLUMNS = ("node", "x_m", "y_m", "z_m", "visible", "doubt")
"""The columns of nodes.csv after the first, which says of which cloud the node is."""


def draw_tracks(result: "TrackResult", names: Sequence[str], path: Path) -> None:
    """Plot clouds with their nodes, projected along the axis of their smallest extent; of more than 12 clouds, 12."""
    clouds = result.clouds
    shown = np.unique(np.linspace(0, len(clouds) - 1, min(len(clouds), MOST_PANELS)).astype(np.int64)).tolist()
    columns = min(len(shown), 3)
    rows = -(-len(shown) // columns)
    figure = Figure(figsize=(5.0 * columns, 4.2 * rows), layout="constrained")
    FigureCanvasAgg(figure)
    extent = np.ptp(np.concatenate([result.nodes_world.reshape(-1, 3), *clouds]), axis=0)
    across, up = sorted(np.argsort(extent)[1:].tolist())
    for place, number in enumerate(shown, start=1):
        axes = figure.add_subplot(rows, columns, place)
        cloud, nodes = clouds[number], result.nodes[number]
        axes.scatter(cloud[:, across], cloud[:, up], s=2, color="0.7", label="cloud")
        draw_nodes(axes, nodes.positions_world, nodes.visible, nodes.topology.edges, across, up)
        axes.set_title(names[int(number)])
        if place == 1:
            axes.legend(fontsize="small")
    figure.savefig(path, dpi=110)


Corner = tuple[float, float, float]


@dataclass(frozen=True, kw_only=True)
class TrackArgs:
    """Track the nodes of a DLO through recorded point clouds, or live in the pictures of a camera, without a robot.

    Try
      dlokit track cloud_0.pcd cloud_1.pcd --initial nodes.csv        recorded clouds; writes nodes and a plot
      dlokit track --camera recorded --camera.path runs/<run>         recorded pictures, in the viewer
      dlokit track --camera realsense --segmentation colour           a RealSense camera, until Ctrl-C

    With a camera the nodes are in the world of its calibration, and the box is there. Adapt the segmentation to your
    DLO: `dlokit track --camera realsense --segmentation colour --help` shows its settings.

    Exit code: 0 a cloud or picture was followed; 1 none was; 2 invalid input.
    """

    clouds: Annotated[tuple[Path, ...], tyro.conf.Positional] = ()
    """Clouds in chronological order: .pcd, .ply, .npy or .csv files of points [m]; those of a shell's * are taken
    by the numbers in their names. Omit them with --camera."""
    camera: Annotated[str | None, one_of(CAMERAS, "none: recorded clouds")] = None
    """Camera whose pictures are followed: recorded, realsense, or another installed one."""
    installation: Annotated[Path | None, flag("FILE")] = None
    """Follow the camera of this installation file; nodes are in its world, on its table. --camera chooses another."""
    segmentation: Annotated[str | None, one_of(SEGMENTATIONS, BrightnessConfig.name)] = None
    """How DLO pixels are found in the pictures of a camera: brightness or colour, or another installed one."""
    initial: Annotated[Path | None, flag("FILE")] = None
    """Nodes (M, 3) [m] at the first cloud, .npy or .csv; the DLO may be branched. Of the nodes of several clouds, as
    this command writes them, those of the last one. Without this file the first cloud is ordered into one chain."""
    out: Path | None = None
    """Folder for nodes.npy, nodes.csv, edges.csv and track.png; default: runs/<time>-track. With a camera it gets
    nodes.csv alone, and without it nothing is written."""
    nodes: Annotated[int, Meta(ge=3)] = BelievedDlo.nodes
    """Number of nodes M, if --initial is not given."""
    length_m: float | None = None
    """Length of the DLO [m], if --initial is not given; default: the length of the first cloud."""
    radius_m: Annotated[float, Meta(ge=1e-4, le=1.0)] | None = None
    """Radius of the DLO [m]; default: 0.004, or that of a thicker DLO where the first cloud shows one."""
    observer: str = "map"
    """Observer strategy: map, anchored, cpd, spr, som, or another installed one."""
    box_lower: Corner | None = None
    """Corner of the box filter with the smallest coordinates [m]; without it, no box is applied."""
    box_upper: Corner | None = None
    """Corner of the box filter with the largest coordinates [m]."""
    voxel_m: NotNegative = CloudConfig.voxel_m
    """Voxel size to which clouds are thinned [m]; 0 keeps all points."""
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


@dataclass(frozen=True, kw_only=True, eq=False)
class TrackResult:
    """The results of tracking F clouds."""

    nodes: tuple[Nodes, ...]
    seconds: tuple[float, ...]
    """Time for filters and observer [s]."""
    clouds: tuple[Float64Array, ...]
    """The filtered clouds (N, 3) [m]."""

    @cached_property
    def nodes_world(self) -> Float64Array:
        """(F, M, 3) [m]."""
        return np.stack([nodes.positions_world for nodes in self.nodes])

    @cached_property
    def distance_m(self) -> Float64Array:
        """(F,) root mean square distance of a cloud's points to the DLO [m]; NaN where it has none."""
        both = zip(self.clouds, self.nodes, strict=True)
        apart = [distance_to_dlo_m(points, nodes.positions_world, nodes.topology) for points, nodes in both]
        return np.array([np.sqrt(np.mean(distances**2)) if len(distances) else np.nan for distances in apart])


@dataclass(frozen=True, kw_only=True)
class TrackSettings:
    """How clouds are filtered and tracked."""

    observer: ObserverStrategyConfig
    nodes: int = BelievedDlo.nodes
    length_m: float | None = None
    radius_m: float | None = None
    box: BoxConfig | None = None
    """None: no box."""
    voxel_m: float = CloudConfig.voxel_m


def run(args: TrackArgs) -> int:
    """Execute the command; returns 0, or 1 where no cloud was followed, or raises `InputError`."""
    settings = _settings(args)
    if args.camera is not None or args.installation is not None:
        return _run_live(args, settings)
    paths = chronological(args.clouds)
    clouds = [read_cloud(path) for path in paths]
    initial = None if args.initial is None else read_nodes(args.initial)
    result = track_clouds(clouds, initial, settings, names=[str(path) for path in paths])
    out = run_folder(args.out, "track")
    write_result(result, paths, out)
    _print(result, paths, out)
    return 0 if any(nodes.doubt is None for nodes in result.nodes) else EXIT_FAULT


def chronological(clouds: Sequence[Path]) -> Sequence[Path]:
    """The clouds as given; those of one folder in a shell's order, 1, 10, 2, by the numbers in their names."""
    by_shell = list(clouds) == sorted(clouds) and len({path.parent for path in clouds}) == 1
    return in_order(clouds) if by_shell else clouds


def _run_live(args: TrackArgs, settings: TrackSettings) -> int:
    """Follow a camera until it ends or Ctrl-C, and print how that went; returns 0, or 1 where nothing was followed."""
    run = RunConfig() if args.installation is None else with_installation(RunConfig(), args.installation)
    run = replace(run, camera=args.camera_settings)
    camera = _camera(args, run)
    # The pictures need libraries that clouds do not.
    require_cell(f"dlokit track --camera {run.camera.name}")
    from dlokit.app.data import live_track

    live = live_track.LiveSettings(segmentation=args.segmentation_settings, **vars(settings))
    path = None if args.out is None else claim_run_folder(args.out) / "nodes.csv"
    summary, tracker = live_track.LiveSummary(), live_track.LiveTracker(live)
    tell = partial(say, Console())

    pace = live_track.FollowPace(rate_hz=args.rate_hz, duration_s=args.duration_s)
    try:
        with live_track.nodes_file(path) as write:
            if args.headless:
                asyncio.run(live_track.follow(camera, tracker, lambda _, frame: write(frame), tell, summary, pace=pace))
            else:
                page = live_track.follow_in_viewer(
                    camera, tracker, write, tell, summary, run=_for_viewer(run, args), pace=pace
                )
                asyncio.run(page)
    except KeyboardInterrupt:
        tell("ended by Ctrl-C")
    for line in summary.lines():
        tell(line)
    return 0 if summary.followed else EXIT_FAULT


def _for_viewer(run: RunConfig, args: TrackArgs) -> RunConfig:
    return replace(
        run,
        viewer=replace(run.viewer, port=args.port),
        model=replace(run.model, nodes=args.nodes, radius_m=args.radius_m or BelievedDlo.radius_m),
    )


def _camera(args: TrackArgs, run: RunConfig) -> Camera:
    config = run.camera
    if args.clouds or args.initial is not None:
        raise InputError(
            "--camera follows pictures: omit the clouds and --initial, or omit --camera and --installation"
        )
    if config.sees_cell:
        real = ", ".join(name for name, of in CAMERAS.installed().items() if not of.sees_cell)
        raise InputError(
            f"--camera {config.name} sees the simulated cell, which runs in `dlokit shape --camera {config.name}`; "
            f"`dlokit track` takes {real}"
        )
    if run.calibration:
        check_has_pose(run.calibration, read_calibration(Path(run.calibration)))
    return placed_camera(run, config.build(NoCell()))


NoCell = MemoryTransport
"""Stands for the cell where there is none: a bus on which nobody serves, so that every call is unreachable."""


def track_clouds(
    clouds: Sequence[Float64Array], initial: Float64Array | None, settings: TrackSettings, *, names: Sequence[str]
) -> TrackResult:
    """Track a DLO through clouds (N, 3) [m], from `initial` nodes (M, 3) [m] or the order of the first cloud.

    The result of each cloud is the prior of the next one. Errors use `names`. Raises `InputError`.
    """
    if not clouds:
        raise InputError("no cloud is given: name at least one .pcd, .ply, .npy or .csv file, or a --camera")
    tracker = Tracker(
        length_m=settings.length_m,
        radius_m=settings.radius_m,
        nodes=settings.nodes,
        observer=settings.observer,
        initial_nodes_world=initial,
    )
    found: list[Nodes] = []
    filtered: list[Float64Array] = []
    seconds: list[float] = []
    for cloud, name in zip(clouds, names, strict=True):
        begin = time.perf_counter()
        try:
            points = filter_cloud(cloud, settings, name)
        except InputError:
            if not found:
                raise
            points = np.empty((0, 3))  # the DLO is not in this cloud, and may be in the next
        try:
            found.append(tracker.update(points))
        except InputError as error:
            raise InputError(f"{name}: {error} (--initial)") from error
        seconds.append(time.perf_counter() - begin)
        filtered.append(points)
    return TrackResult(nodes=tuple(found), seconds=tuple(seconds), clouds=tuple(filtered))


def filter_cloud(points: Float64Array, settings: TrackSettings, name: str) -> Float64Array:
    """Apply perception's filters for single clouds: box, thinning, isolated points. Raises `InputError`."""
    inside = points if settings.box is None else points[inside_box(points, settings.box)]
    thinned = thin(inside, settings.voxel_m)
    kept = thinned[~lonely(thinned, settings.voxel_m)]
    if len(kept) < 2:
        raise InputError(
            f"{name}: of {len(points)} points {len(inside)} are in the box, in {len(thinned)} cubes of --voxel-m "
            f"{settings.voxel_m:g}, and {len(kept)} of these are not isolated; at least 2 are needed: widen the box, "
            "make the cubes smaller, or check that the cloud is in metres"
        )
    return kept


def write_result(result: TrackResult, clouds: Sequence[Path], out: Path) -> None:
    """Write nodes.npy (F, M, 3), nodes.csv, edges.csv and track.png to a folder."""
    edges = result.nodes[0].topology.edges
    np.save(out / "nodes.npy", result.nodes_world)
    np.savetxt(out / "edges.csv", edges, fmt="%d", delimiter=",", header="node,node", comments="")
    with (out / "nodes.csv").open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(("cloud", *NODE_COLUMNS))
        for number, nodes in enumerate(result.nodes):
            writer.writerows(node_rows(nodes, number))
    draw_tracks(result, [path.name for path in clouds], out / "track.png")


def node_rows(nodes: Nodes, cloud: int) -> Iterator[tuple[object, ...]]:
    """The rows of nodes.csv: the cloud's number or stamp, and `NODE_COLUMNS`."""
    for node, (x, y, z) in enumerate(nodes.positions_world.tolist()):
        yield cloud, node, f"{x:.6f}", f"{y:.6f}", f"{z:.6f}", int(nodes.visible[node]), _doubt(nodes)


def _doubt(nodes: Nodes) -> str:
    return "" if nodes.doubt is None else nodes.doubt.value


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


def _print(result: TrackResult, clouds: Sequence[Path], out: Path) -> None:
    table = Table("cloud", "points", "visible", "health", "distance, mm", "time, ms", "doubt")
    for number, (path, nodes) in enumerate(zip(clouds, result.nodes, strict=True)):
        table.add_row(
            path.name,
            str(len(result.clouds[number])),
            f"{np.count_nonzero(nodes.visible)}/{len(nodes.visible)}",
            f"{nodes.health:.2f}",
            f"{result.distance_m[number] * 1000:.1f}",
            f"{result.seconds[number] * 1000:.0f}",
            _doubt(nodes),
        )
    console = Console()
    console.print(table)
    say(console, f"nodes.npy, nodes.csv, edges.csv and track.png in {out}")
    doubts = Counter(map(_doubt, result.nodes))
    summary = f"{doubts.pop('', 0)} of {len(clouds)} clouds followed"
    others = ", ".join(f"{doubt} ({count})" for doubt, count in doubts.items())
    say(console, f"{summary}; not followed: {others}" if others else summary)


COMMAND = CliCommand(TrackArgs, run, _defaults)
