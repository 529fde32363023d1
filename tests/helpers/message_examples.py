"""Random values of any type in messages, generated from the type alone: a new field needs no change here."""

import enum
import math
import types
from collections.abc import Callable
from random import Random
from typing import Annotated, Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

import msgspec
import numpy as np

from dlokit import geometry
from dlokit.types.action import VelocityProfile
from dlokit.types.arrays import Float32Array
from dlokit.types.image import CameraCalibration, RawCamera
from dlokit.types.pose import Pose
from dlokit.types.robot import JointTrajectory

_ODD_FLOATS = (0.0, -0.0, 1e-300, -1e300, float("nan"), float("inf"), float("-inf"))
_ODD_INTS = (0, 1, -1, 127, 128, 2**31, -(2**63), 2**63 - 1)
_LETTERS = "abc äß漢\x00\n"
_MOST = 4
"""Items of a list, and extent of an axis."""


def example(wanted: Any, rng: Random) -> Any:
    """A value of a type in messages: plain values, Structs, enums, arrays, and collections of those."""
    if isinstance(wanted, type) and issubclass(wanted, enum.Enum):
        return rng.choice(list(wanted))
    if wanted in _VALID:
        return _VALID[wanted](rng)
    if _is_struct(wanted):
        return _struct(wanted, rng)
    if wanted in _PLAIN:
        return _PLAIN[wanted](rng)
    return _composed(wanted, rng)


def _composed(wanted: Any, rng: Random) -> Any:
    origin, args = get_origin(wanted), get_args(wanted)
    if origin in (Union, types.UnionType):
        return example(rng.choice(args), rng)
    if origin is np.ndarray:
        return _array(get_args(args[1])[0], rng)
    if origin is tuple and args[-1:] == (...,):
        return tuple(example(args[0], rng) for _ in range(rng.randrange(_MOST)))
    if origin is tuple:
        return tuple(example(each, rng) for each in args)
    if origin is list:
        return [example(args[0], rng) for _ in range(rng.randrange(_MOST))]
    if origin is dict:
        return {example(args[0], rng): example(args[1], rng) for _ in range(rng.randrange(_MOST))}
    if origin is Annotated:
        if args[0] is int and (bounds := [note for note in args[1:] if isinstance(note, msgspec.Meta)]):
            return rng.randint(int(bounds[0].ge or 0), int(bounds[0].le or 2**40))
        return example(args[0], rng)
    if origin is Literal:
        return rng.choice(args)
    raise NotImplementedError(f"no example of {wanted} is known; add it here")


def _is_struct(wanted: Any) -> bool:
    cls = get_origin(wanted) or wanted
    return isinstance(cls, type) and issubclass(cls, msgspec.Struct)


def _struct(wanted: Any, rng: Random) -> msgspec.Struct:
    cls = get_origin(wanted) or wanted
    meant: dict[Any, Any] = dict(zip(getattr(cls, "__parameters__", ()), get_args(wanted), strict=False))
    hints = get_type_hints(cls, include_extras=True)
    values: dict[str, Any] = {}
    for name in cls.__struct_fields__:
        hint = hints[name]
        values[name] = example(meant[hint] if isinstance(hint, TypeVar) else hint, rng)
    return cls(**values)


def _array(dtype: Any, rng: Random) -> Any:
    shape = tuple(rng.randrange(_MOST) for _ in range(rng.randrange(4)))
    count = int(np.prod(shape))
    if dtype is np.bool_:
        flat = np.array([rng.random() < 0.5 for _ in range(count)], dtype=np.bool_)
    else:
        # Any bytes are a number, also NaN, whose bits must be preserved.
        flat = np.frombuffer(rng.randbytes(count * np.dtype(dtype).itemsize), dtype=dtype)
    return flat.reshape(shape)


_PLAIN: dict[Any, Any] = {
    bool: lambda rng: rng.random() < 0.5,
    int: lambda rng: rng.choice((*_ODD_INTS, rng.randrange(-(2**40), 2**40))),
    float: lambda rng: rng.choice((*_ODD_FLOATS, rng.uniform(-10.0, 10.0))),
    str: lambda rng: "".join(rng.choice(_LETTERS) for _ in range(rng.randrange(2 * _MOST))),
    bytes: lambda rng: rng.randbytes(rng.randrange(2 * _MOST)),
    type(None): lambda rng: None,
}


_NEVER_ZERO = np.array([20.0, 0.0, 0.0, 0.0])  # added to four numbers of at most 10, it gives a direction


def _floats(rng: Random, *shape: int) -> Any:
    return np.array([rng.uniform(-10.0, 10.0) for _ in range(math.prod(shape))]).reshape(shape)


def _trajectory(rng: Random) -> JointTrajectory:
    samples, joints = rng.randrange(1, _MOST), rng.randrange(1, _MOST)
    q, dq, ddq = (_floats(rng, samples, joints) for _ in range(3))
    return JointTrajectory(times_s=_floats(rng, samples), q_rad=q, dq_rad_s=dq, ddq_rad_s2=ddq)


def _profile(rng: Random) -> VelocityProfile:
    speed, acceleration, jerk = (rng.uniform(1e-3, 10.0) for _ in range(3))
    return VelocityProfile(speed_m_s=speed, acceleration_m_s2=acceleration, jerk_m_s3=jerk)


def _optics(rng: Random, width_px: int, height_px: int) -> dict[str, float]:
    focal_px = max(width_px, height_px) * rng.uniform(0.2, 10.0)
    centre_px = {"cx_px": rng.uniform(-0.5, 1.5) * width_px, "cy_px": rng.uniform(-0.5, 1.5) * height_px}
    return {"fx_px": focal_px, "fy_px": focal_px * rng.uniform(0.9, 1.1), **centre_px}


def _lens(rng: Random) -> Float32Array:
    return _floats(rng, rng.choice((4, 5, 8, 12, 14))).astype(np.float32)


def _raw_camera(rng: Random, width_px: int = 640, height_px: int = 480) -> RawCamera:
    turn = geometry.pose(_floats(rng, 3), _floats(rng, 4) + 3.0 * _NEVER_ZERO).wxyz  # by less than 60°
    return RawCamera(**_optics(rng, width_px, height_px), wxyz=turn, distortion=_lens(rng))


def _calibration(rng: Random) -> CameraCalibration:
    hints = get_type_hints(CameraCalibration, include_extras=True)
    values = {name: example(hints[name], rng) for name in CameraCalibration.__struct_fields__}
    size_px = (rng.randrange(1, 4000), rng.randrange(1, 4000))
    values |= {"width_px": size_px[0], "height_px": size_px[1], **_optics(rng, *size_px)}
    values |= {"baseline_m": rng.choice((None, 0.1)), "stamps_late_s": rng.uniform(-1.0, 1.0)}
    separate = rng.random() < 0.5
    values |= {name: _raw_camera(rng, *size_px) if separate else None for name in ("raw_left", "raw_right")}
    values |= {name: None if separate else _lens(rng) for name in ("distortion", "distortion_right")}
    if separate:
        values |= {"baseline_m": 0.1}
    return CameraCalibration(**values)


_VALID: dict[Any, Callable[[Random], Any]] = {
    Pose: lambda rng: geometry.pose(_floats(rng, 3), _floats(rng, 4) + _NEVER_ZERO),
    VelocityProfile: _profile,
    JointTrajectory: _trajectory,
    RawCamera: _raw_camera,
    CameraCalibration: _calibration,
}
"""Types that refuse invalid values on construction."""
