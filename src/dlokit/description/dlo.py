"""DLO presets: physical properties of ropes, hoses and wires, each with the source of its numbers."""

import math
from dataclasses import dataclass, replace
from typing import Annotated

from msgspec import Meta

from dlokit.errors import ConfigError
from dlokit.ranges import Fraction, NotNegative, Positive, check_ranges

GRAVITY_M_S2 = 9.81
"""Gravity in the cell and in the model [m/s²]."""


@dataclass(frozen=True, kw_only=True)
class DloPreset:
    """One kind of deformable linear object."""

    name: str
    """Short name, for messages and tables."""
    length_m: Positive = 0.5
    """Length along the rod [m]."""
    radius_m: Positive = 0.004
    """Radius of its round cross-section [m]."""
    mass_per_length_kg_m: Positive = 0.03
    """Mass per length [kg/m]."""
    bending_stiffness_n_m2: Positive = 1.0e-5
    """EI, the moment that bends it to a curvature of one radian per metre [N·m²]. Larger: stiffer."""
    poisson: Annotated[float, Meta(ge=0.0, le=0.5)] = 0.3
    """Poisson's ratio. Larger: less stiff against twist."""
    damping_s: NotNegative = 0.05
    """Rayleigh damping: viscous bending moment as a fraction of the elastic one [s]. Larger: sooner at rest."""
    yield_curvature_1_m: Positive | None = None
    """Curvature up to which it springs back [1/m]; bending beyond it is permanent. Without it, it always springs back.
    Only the elastoplastic chain bends permanently; an elastic rod never does."""
    curl_1_m: float = 0.0
    """Curvature without load, e.g. from the reel [1/m]; the sign gives the side."""
    friction: NotNegative = 0.8
    """Coefficient of sliding friction on the table and between its own loops."""
    color_rgb: tuple[Fraction, Fraction, Fraction] = (0.93, 0.88, 0.74)
    """Colour: red, green and blue, each 0 to 1."""

    def __post_init__(self) -> None:
        check_ranges(self, "cell.dlo")
        if not abs(self.curl_1_m) * self.length_m < 2.0 * math.pi:
            raise ConfigError(
                f"--cell.dlo.curl-1-m is {self.curl_1_m}; over its length the {self.name} must turn by less than a "
                "full circle."
            )

    @property
    def mass_kg(self) -> float:
        """Mass of the whole rod [kg]."""
        return self.mass_per_length_kg_m * self.length_m

    @property
    def young_pa(self) -> float:
        """Young's modulus of a solid round rod of this bending stiffness, ``E = EI / (π r⁴ / 4)`` [Pa]."""
        return self.bending_stiffness_n_m2 / (math.pi * self.radius_m**4 / 4.0)

    @property
    def smallest_held_radius_m(self) -> float:
        """Radius of the tightest arc that friction on a table can hold, ``(EI / (μ w))^(1/3)`` [m].

        w is the weight per length. A tighter shape springs back when it is released.
        """
        weight_n_m = self.mass_per_length_kg_m * GRAVITY_M_S2
        return (self.bending_stiffness_n_m2 / (self.friction * weight_n_m)) ** (1.0 / 3.0)


SOFT_ROPE = DloPreset(name="soft_rope")
"""Estimate for a braided 8 mm cotton rope. Catalogue weights are 30 to 45 g/m. Bending stiffness by Peirce's
cantilever, EI = w c³, with a bending length c of 3.2 cm: a soft braid. Friction of cotton on a matt table 0.6 to 0.8;
here the upper end."""
SILICONE_HOSE = DloPreset(
    name="silicone_hose",
    mass_per_length_kg_m=0.044,
    bending_stiffness_n_m2=3.7e-4,
    poisson=0.45,
    friction=0.9,
    color_rgb=(0.90, 0.90, 0.88),
)
"""Computed: tube 8 mm outside, 4 mm inside, silicone of Shore 50 A (E about 2 MPa), 1.15 g/cm³:
EI = E π (R⁴ - r⁴) / 4 = 3.8e-4 N·m², 43 g/m. Silicone on wood: friction about 0.9."""

# The wires a, b and c were identified with a discrete elastic rod by Q. J. Chen, T. Bretl, Q.-C. Pham, Accurate
# Simulation and Parameter Identification of Deformable Linear Objects using Discrete Elastic Rods in Generalized
# Coordinates, arXiv:2310.00911; figures from their repository qj25/adapteddlo_muj (February 2025). Radii are from
# their simulations. Yield curvature and friction of all wires are estimates: they are not published.
_WIRE = DloPreset(
    name="wire",
    radius_m=0.003,
    yield_curvature_1_m=1.0,  # a bend of 8 cm radius keeps 92 % of its curvature, as copper does
    friction=0.5,
)
WIRE_A = replace(
    _WIRE,
    name="wire_a",
    mass_per_length_kg_m=0.0174,
    bending_stiffness_n_m2=1.22e-4,
    color_rgb=(0.93, 0.93, 0.93),
)
"""White wire, 0.087 kg on 5.0 m, twist over bending stiffness 0.82."""
WIRE_B = replace(
    _WIRE,
    name="wire_b",
    mass_per_length_kg_m=0.0215,
    bending_stiffness_n_m2=9.3e-4,
    color_rgb=(0.95, 0.72, 0.66),
)
"""Red wire, 0.043 kg on 2.0 m, twist over bending stiffness 1.64."""
WIRE_C = replace(
    _WIRE,
    name="wire_c",
    mass_per_length_kg_m=0.0272,
    bending_stiffness_n_m2=1.20e-3,
    color_rgb=(0.80, 0.88, 0.95),
)
"""Black wire, 0.081 kg on 2.98 m, twist over bending stiffness 1.46."""
THIN_WIRE = replace(
    _WIRE,
    name="thin_wire",
    mass_per_length_kg_m=0.017,
    bending_stiffness_n_m2=5.6e-5,
    color_rgb=(0.92, 0.86, 0.30),
)
"""Lower end of published wires, 5.6e-5 to 1.0e-3 N·m² and 17 to 27 g/m."""
STIFF_WIRE = replace(
    _WIRE,
    name="stiff_wire",
    mass_per_length_kg_m=0.027,
    bending_stiffness_n_m2=1.0e-3,
    color_rgb=(0.92, 0.86, 0.30),
)
"""Upper end of published wires."""

PRESETS = (SOFT_ROPE, SILICONE_HOSE, WIRE_A, WIRE_B, WIRE_C, THIN_WIRE, STIFF_WIRE)
"""Every preset that ships, the default first."""


def preset(name: str) -> DloPreset:
    """The preset called `name`, with hyphens or underscores. Raises ConfigError, which lists the names."""
    for candidate in PRESETS:
        if candidate.name == name.replace("-", "_"):
            return candidate
    allowed = ", ".join(candidate.name for candidate in PRESETS)
    raise ConfigError(f"There is no DLO preset {name!r}; choose one of {allowed}.")
