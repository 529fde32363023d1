"""How far a calibrated camera of the cell is from the truth, and what a run gains or loses by its calibration.

python benchmarks/calibration.py --seeds 20 --paper 4
"""

import tempfile
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from rich.console import Console
from scipy.spatial.transform import Rotation

from dlokit import geometry
from dlokit.description.arm.franka import PANDA
from dlokit.errors import ConfigError, MachineError
from dlokit.extras.bench.report import BenchFigure, figure
from dlokit.extras.bench.shaping.cases import cases, methods_of
from dlokit.extras.bench.shaping.runner import attempt_case
from dlokit.extras.bench.shaping.suites import paper_suite
from dlokit.extras.bench.statistics import Interval, bootstrap, median
from dlokit.extras.calibration.board_poses import HeldBoard, board_poses
from dlokit.extras.calibration.cell_pictures import BoardPicture, cell_config, pictures_of_held_board, without_optics
from dlokit.extras.calibration.hand_eye import boards_in_world
from dlokit.extras.calibration.procedure import (
    FEWEST_SHOTS,
    CalibratedPose,
    TakenPicture,
    calibrate_pose,
    find_shots,
)
from dlokit.functional.cameras.calibration_file import write_calibration
from dlokit.functional.cell.board import BOARD, T_TCP_BOARD, draw_board
from dlokit.motion.forward_kinematics import tcp_pose
from dlokit.system.config import RunConfig
from dlokit.types.arrays import Float64Array
from dlokit.types.image import CameraCalibration, StereoImages
from parts.command import check_json, run_study, write_figures

_PERCENTILE = 95.0
_LENSES = "lenses, joints off by 0.1°, print by 0.2 %"


@dataclass(frozen=True, kw_only=True)
class Args:
    """Calibrate the cell's camera by a board in the hand, and compare with the truth at poses that were not fitted.

    A lens distorts the pictures, every joint reports an angle that is off by 0.1° to either side, and the board is
    printed 0.2 % too large. The error of a held-out pose is the distance of the board as the calibrated camera sees it
    from where it truly is. With --paper the experiments of the paper run with the calibration file of their seed and
    with the camera's own calibration, which is off by 3 mm and 0.2°; the optics of the latter are the true ones.
    """

    seeds: int = 20
    """Calibrations, with seeds 0 to K-1."""
    poses: int = 25
    """Poses of each; every fifth is held out."""
    paper: int = 0
    """Seeds of the paper's five experiments, at most as many as --seeds."""
    json: Path | None = None
    """Write the figures to this file."""


@dataclass(frozen=True, kw_only=True, eq=False)
class CalibratedSeed:
    """The calibration of one seed, and its errors at the held-out poses."""

    found: CalibratedPose
    true_m: Float64Array  # (K,) of the board's centre against the truth
    true_deg: Float64Array  # (K,)
    apart_m: Float64Array  # (K,) camera against arm


def run(args: Args) -> int:
    """Calibrate every seed, run the experiments, and print; exit code 0."""
    if args.seeds < 1 or args.poses < FEWEST_SHOTS or not 0 <= args.paper <= args.seeds:
        raise ConfigError(
            f"--seeds {args.seeds} must be at least 1, --poses {args.poses} at least {FEWEST_SHOTS}, and --paper "
            f"{args.paper} from 0 to --seeds."
        )
    check_json(args.json)
    console = Console(highlight=False, soft_wrap=True)
    done: list[CalibratedSeed] = []
    for seed in range(args.seeds):
        one = calibrated(seed, args.poses)
        done.append(one)
        console.print(
            f"seed {seed:2}: at most {one.true_m.max() * 1e3:.2f} mm and {one.true_deg.max():.3f}° from the truth, "
            f"camera and arm {one.apart_m.max() * 1e3:.2f} mm apart, corners {one.found.fit.rms_px:.3f} px"
        )
    rows = _figures(done, console)
    if args.paper:
        rows += paper_figures([one.found.fit.camera for one in done[: args.paper]], console)
    config = {"seeds": args.seeds, "poses": args.poses, "paper": args.paper}
    write_figures(args.json, "calibration", rows, config, console)
    return 0


def calibrated(seed: int, poses: int) -> CalibratedSeed:
    """One calibration, from the pictures and states that the cell reports, and its errors."""
    config = cell_config(seed, held=True, lens_distortion=True)

    def plan(camera: CameraCalibration) -> tuple[Float64Array, ...]:
        return board_poses(HeldBoard(board=BOARD, T_tcp_board=T_TCP_BOARD), camera, poses, np.random.default_rng(seed))

    pictures = pictures_of_held_board(config, plan, lambda number, count: None)
    shots = find_shots([_taken(picture) for picture in pictures], BOARD)
    camera = without_optics(pictures[0].images.calibration, "")
    found = calibrate_pose(shots, BOARD, camera, fit_optics=True)
    seen = boards_in_world(found.partial, found.kept, BOARD)
    true = np.array([_true_board(config, shot.q_rad) for shot in found.kept])
    centre = np.append(BOARD.outline_board.mean(axis=0), 1.0)
    turns = Rotation.from_matrix(np.swapaxes(true[:, :3, :3], 1, 2) @ seen[:, :3, :3])
    return CalibratedSeed(
        found=found,
        true_m=np.linalg.norm(((seen - true) @ centre)[:, :3], axis=1),
        true_deg=np.degrees(turns.magnitude()),
        apart_m=found.apart.position_m,
    )


def _taken(picture: BoardPicture) -> TakenPicture:
    if picture.robot is None:
        raise MachineError("the cell's arm reported no state with a picture; run the study again")
    images = picture.images
    assert isinstance(images, StereoImages), "the study looks with the stereo camera"
    return TakenPicture(
        left=images.left,
        right=images.right,
        T_world_tcp=picture.robot.T_world_tcp,
        q_rad=picture.robot.q_rad,
    )


def _true_board(config: RunConfig, reported_rad: Float64Array | None) -> Float64Array:
    """``T_world_board`` (4, 4) as it truly was when the arm reported these angles (7,) [rad]."""
    assert config.cell.board is not None
    assert reported_rad is not None
    drawn = draw_board(config.cell.board, config.seed, PANDA)
    assert drawn.T_tcp_board is not None
    return geometry.matrix(geometry.compose(tcp_pose(PANDA, reported_rad - drawn.joint_offsets_rad), drawn.T_tcp_board))


def _figures(done: list[CalibratedSeed], console: Console) -> list[BenchFigure]:
    metrics = (
        ("p95 distance from the truth at held-out poses", [one.true_m for one in done], "m", 1e3, "mm"),
        ("p95 angle to the truth at held-out poses", [one.true_deg for one in done], "deg", 1.0, "°"),
        ("p95 distance of camera and arm at held-out poses", [one.apart_m for one in done], "m", 1e3, "mm"),
    )
    rows: list[BenchFigure] = []
    for metric, values, unit, factor, shown in metrics:
        interval = _percentile(np.array(values))
        low, high = (factor * (end or 0.0) for end in (interval.low, interval.high))
        within = "" if interval.low is None else f" ({low:.2f} to {high:.2f})"
        console.print(f"{metric}: {interval.value * factor:.3f} {shown}{within}, {interval.n} seeds")
        rows.append(figure(_LENSES, "robust fit", metric, interval, unit))
    for name in done[0].found.fit.rms_by_method_px:
        rms = median([one.found.fit.rms_by_method_px[name] for one in done])
        rows.append(figure(_LENSES, name, "median error of the corners", rms, "px"))
    rows.append(
        figure(
            _LENSES, "robust fit", "median error of the corners", median([one.found.fit.rms_px for one in done]), "px"
        )
    )
    return rows


def _percentile(values: Float64Array) -> Interval:
    """The 95th percentile of values (seeds, poses); its interval by resampling seeds."""

    def of_seeds(samples: Float64Array) -> Float64Array:
        picked = values[samples.astype(np.int64)].reshape(len(samples), -1)
        return np.asarray(np.percentile(picked, _PERCENTILE, axis=1), dtype=np.float64)

    return bootstrap(np.arange(len(values)), np.random.default_rng(0), statistic=of_seeds)


def paper_figures(cameras: list[CameraCalibration], console: Console) -> list[BenchFigure]:
    """True RMSE of the paper's experiments with each calibration, and with the camera's own."""
    given = RunConfig(headless=True, record=False)
    given = replace(given, cell=replace(given.cell, lens_distortion=True))
    methods = methods_of(given, (), ())
    true_m: dict[str, list[float]] = {"given pose": [], "calibrated": []}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for case in cases(paper_suite(), len(cameras), methods):
            file = folder / f"{case.seed}.toml"
            write_calibration(file, cameras[case.seed])
            for method, config in (("given pose", given), ("calibrated", replace(given, calibration=str(file)))):
                done = attempt_case(case, config, folder / "run")
                if done.result.true_rmse_m is None:
                    raise MachineError(f"{case.experiment.name}, seed {case.seed} failed: {done.fault}")
                true_m[method].append(done.result.true_rmse_m)
            line = ", ".join(f"{method} {values[-1] * 1e3:.1f} mm" for method, values in true_m.items())
            console.print(f"{case.experiment.name:12} seed {case.seed}: true RMSE {line}")
    rng = np.random.default_rng(0)
    rows: list[BenchFigure] = []
    for method, values in true_m.items():
        mean = bootstrap(values, rng)
        console.print(f"mean true RMSE, {method}: {mean.value * 1e3:.2f} mm of {mean.n} runs")
        rows.append(figure("paper suite", method, "mean true_rmse_m", mean, "m"))
    more = bootstrap(np.subtract(true_m["calibrated"], true_m["given pose"]), rng)
    low, high = (1e3 * (end or 0.0) for end in (more.low, more.high))
    console.print(f"calibrated minus given: {more.value * 1e3:+.2f} mm ({low:+.2f} to {high:+.2f})")
    rows.append(figure("paper suite", "calibrated minus given pose", "mean difference of true_rmse_m", more, "m"))
    return rows


if __name__ == "__main__":
    run_study(Args, run, __doc__)
