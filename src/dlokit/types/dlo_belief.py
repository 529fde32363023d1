"""What is believed of the DLO: its measures, each with how sure it is."""

import math

from dlokit.types.message import Message, Value

_CONTRADICTS_SDS = 3.0


class Figure(Value, frozen=True, kw_only=True, eq=False):
    """A number above 0 that is known to a factor: its logarithm is normally distributed."""

    value: float
    """The median; where it is not believed more or less than twice, the best guess."""
    log_sd: float = 0.0
    """Standard deviation of the logarithm: 0.1 is about 10 %."""

    def between(self, sds: float = 2.0) -> tuple[float, float]:
        """The interval of so many standard deviations to either side; of two it holds 95 %."""
        factor = math.exp(sds * self.log_sd)
        return self.value / factor, self.value * factor

    def with_measured(self, measured: "Figure") -> "Figure":
        """This figure and a measured one together, as sure as each is; one that contradicts it takes its place."""
        apart = math.log(measured.value / self.value)
        if abs(apart) > _CONTRADICTS_SDS * math.hypot(self.log_sd, measured.log_sd) or self.log_sd == 0.0:
            return measured if abs(apart) > _CONTRADICTS_SDS * measured.log_sd else self
        share = self.log_sd**2 / (self.log_sd**2 + measured.log_sd**2)
        log_sd = self.log_sd * measured.log_sd / math.hypot(self.log_sd, measured.log_sd)
        return Figure(value=self.value * math.exp(share * apart), log_sd=log_sd)


class DloBelief(Message, frozen=True, kw_only=True, eq=False):
    """The DLO as the system believes it to be, as configured at first and as learnt from then on.

    Stiffness and friction are not independent of one another: what a rod on a table shows best is the ratio of both,
    `elastic_m3`, which is surer than either.
    """

    length_m: Figure
    radius_m: Figure
    bending_stiffness_n_m2: Figure
    """Bending stiffness EI [N·m²]."""
    weight_n_m: Figure
    """Weight per length w [N/m]."""
    friction: Figure
    """Coefficient μ of sliding friction on the table."""
    elastic_m3: Figure
    """EI / (μ w) [m³]; its cube root is about the radius of the tightest arc that friction holds."""
    yield_curvature_1_m: float | None = None
    """Curvature beyond which the DLO keeps a bend [1/m]; None: it is taken to spring back always."""
    takes_set: float = 1.0
    """How probable it is that the DLO keeps bends at all, 0 to 1."""
    actions: int = 0
    """Actions that it was learnt from; 0: it is what was configured."""

    @property
    def held_radius_m(self) -> float:
        """About the radius of the tightest arc that friction holds, ``(EI / (μ w))^(1/3)`` [m]."""
        return self.elastic_m3.value ** (1.0 / 3.0)
