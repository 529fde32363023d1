"""What the system is told when another DLO is laid on the table: what a ruler tells, and what the run itself says."""

from dataclasses import replace

from dlokit.description.dlo import SILICONE_HOSE, WIRE_B
from dlokit.rod.believed import BeliefConfig, ModelConfig
from dlokit.system.config import UNKNOWN_STIFFNESS_LOG_SD, RunConfig, with_dlo


def test_the_rope_that_ships_is_believed_as_it_ships() -> None:
    run = RunConfig()
    assert with_dlo(run, run.cell.dlo) == run


def test_of_another_dlo_length_and_radius_are_told_and_its_stiffness_is_unknown() -> None:
    model = with_dlo(RunConfig(), SILICONE_HOSE).model
    assert (model.length_m, model.radius_m) == (SILICONE_HOSE.length_m, SILICONE_HOSE.radius_m)
    assert model.bending_stiffness_n_m2 == ModelConfig().bending_stiffness_n_m2 != SILICONE_HOSE.bending_stiffness_n_m2
    assert model.belief.stiffness_log_sd == UNKNOWN_STIFFNESS_LOG_SD


def test_a_stiffness_that_the_run_tells_is_believed_as_surely_as_it_says() -> None:
    told = ModelConfig(bending_stiffness_n_m2=4e-4, belief=BeliefConfig(stiffness_log_sd=0.9))
    model = with_dlo(replace(RunConfig(), model=told), WIRE_B).model
    assert (model.bending_stiffness_n_m2, model.belief.stiffness_log_sd) == (4e-4, 0.9)


def test_how_sure_the_run_is_of_the_shipped_stiffness_is_believed_too() -> None:
    told = ModelConfig(belief=BeliefConfig(stiffness_log_sd=0.5))
    assert with_dlo(replace(RunConfig(), model=told), WIRE_B).model.belief.stiffness_log_sd == 0.5
