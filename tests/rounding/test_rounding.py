"""Shapes, verdicts and choices do not depend on rounding, and hence not on the processor."""

import os
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rounding_scenes
from rounding_scenes import SCENES, Outcome, Rounded

from dlokit.types.arrays import Float64Array

GROWN_M = 1e-6
"""[m]. A user would notice 0.1 mm. Well-posed calculations stay below 1e-8; a tie that rounding breaks gives 1e-5."""
RELATIVE = 1e-12
"""Perturbation of inputs: a thousand times the rounding of one operation, as after a long calculation."""


def as_it_is(array: Float64Array) -> Float64Array:
    return array


def moved(seed: int) -> Rounded:
    rng = np.random.default_rng(seed)
    return lambda array: array * (1.0 + RELATIVE * rng.uniform(-1.0, 1.0, array.shape))


def differences(one: Mapping[str, Any], other: Mapping[str, Any]) -> list[str]:
    assert set(one) == set(other)
    found = list[str]()
    for key, value in one.items():
        if isinstance(value, str):
            if value != str(other[key]):
                found.append(f"{key}: {value!r} became {other[key]!r}")
        elif not (apart_m := float(np.abs(value - other[key]).max())) <= GROWN_M:
            found.append(f"{key}: {apart_m * 1000.0:.3g} mm apart")
    return found


@pytest.mark.heavy
@pytest.mark.parametrize("seeds", [(0,), pytest.param((1, 2, 3), marks=pytest.mark.long)], ids=["once", "often"])
@pytest.mark.parametrize("scene", SCENES, ids=lambda scene: scene.__name__)
def test_inputs_perturbed_by_rounding_give_the_same_results(scene: Any, seeds: tuple[int, ...]) -> None:
    before: Outcome = scene(as_it_is)
    assert before
    for seed in seeds:
        assert not differences(before, scene(moved(seed)))


@pytest.mark.long
def test_a_processor_without_avx_gives_the_same_results(tmp_path: Path) -> None:
    # An x86-64 without AVX: Numba compiles for it, NumPy and OpenBLAS take other paths.
    instructions: Any = np.show_config(mode="dicts")
    plain = {
        "NUMBA_CPU_NAME": "generic",
        "NUMBA_CACHE_DIR": str(tmp_path / "cache"),
        "NPY_DISABLE_CPU_FEATURES": " ".join(instructions["SIMD Extensions"].get("found", ())),
        "OPENBLAS_CORETYPE": "Prescott",
    }
    out = tmp_path / "plain.npz"
    script = [sys.executable, rounding_scenes.__file__, str(out)]
    done = subprocess.run(script, env=os.environ | plain, capture_output=True, text=True, timeout=600, check=False)
    assert done.returncode == 0, done.stderr
    with np.load(out) as there:
        assert not differences(rounding_scenes.all_scenes(), there)
