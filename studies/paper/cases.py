"""What the paper computes: its three cases, each a sweep, and sweeps to compare them with."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

MEAN_VELOCITY = "inflow.mean_velocity"


@dataclass(frozen=True)
class Curve:
    """One sweep over the mean inflow velocity.

    Attributes:
        name: name of its folder and of its table.
        label: name in the legends.
        scene: case of the catalogue.
        velocities: mean inflow velocities in m/s, in the order of the continuation.
        settings: what differs from the catalogue's case, as KEY=VALUE.
    """

    name: str
    label: str
    scene: str
    velocities: tuple[float, ...]
    settings: tuple[str, ...] = ()


@dataclass(frozen=True)
class PaperCase:
    """One of the paper's cases.

    Attributes:
        number: 1 to 3; section 5.1 to 5.3.
        title: materials of flap and roof.
        curve: its sweep.
        comparisons: sweeps that are drawn beside it in the curves.
    """

    number: int
    title: str
    curve: Curve
    comparisons: tuple[Curve, ...] = ()

    @property
    def curves(self) -> tuple[Curve, ...]:
        """The case's own sweep, then the comparisons."""
        return (self.curve, *self.comparisons)

    @property
    def figures(self) -> dict[str, int]:
        """The paper's number of each figure: velocity, pressure, displacement and forces."""
        first = 3 * self.number
        return {"velocity": first, "pressure": first + 1, "displacement": first + 2, "forces": 11 + self.number}


def steps(size: float, count: int = 10) -> tuple[float, ...]:
    """Return size, 2 size, ..., count size, without rounding errors."""
    return tuple(round(k * size, 10) for k in range(1, count + 1))


# The paper's step is 0.0055 m/s in cases 2 and 3, its pictures belong to 0.12 m/s.
SLOW = (*steps(0.0055), 0.06, 0.07, 0.08, 0.09, 0.1, 0.11, 0.12)
STEPS = steps(0.012)
FAST = (*STEPS, 0.14, 0.16, 0.18, 0.2)

# The St. Venant-Kirchhoff flap collapses at its root corner, the earlier the finer the mesh is there.
ROOT = Curve("svk-root-0.005", "root size 0.005 m", "flap-svk", STEPS, ("mesh.root_size=0.005",))
FINE_ROOT = Curve("svk-root-0.0025", "root size 0.0025 m", "flap-svk", STEPS, ("mesh.root_size=0.0025",))

NEO_HOOKEAN = Curve("neo-hookean-rigid-roof", "rigid roof", "flap-neo-hookean", FAST)
MOONEY_RIVLIN = Curve("mooney-rivlin-rigid-roof", "rigid roof, K = 5.6 Pa", "flap-mooney-rivlin", SLOW)
MOONEY_RIVLIN_STIFF = Curve(
    "mooney-rivlin-rigid-roof-stiff-bulk",
    "rigid roof, K = 17500 Pa",
    "flap-mooney-rivlin",
    SLOW,
    ("solid.flap.bulk_modulus=1.75e4",),
)

CASES: tuple[PaperCase, ...] = (
    PaperCase(
        1,
        "St. Venant-Kirchhoff flap, rigid walls",
        Curve("case-1", "root size 0.01 m", "flap-svk", STEPS),
        (ROOT, FINE_ROOT),
    ),
    PaperCase(
        2,
        "neo-Hookean flap, St. Venant-Kirchhoff roof",
        Curve("case-2", "elastic roof", "flap-neo-hookean-roof", SLOW),
        (NEO_HOOKEAN,),
    ),
    PaperCase(
        3,
        "Mooney-Rivlin flap, St. Venant-Kirchhoff roof",
        Curve("case-3", "elastic roof, K = 5.6 Pa", "flap-mooney-rivlin-roof", SLOW),
        (MOONEY_RIVLIN, MOONEY_RIVLIN_STIFF),
    ),
)


def all_curves(cases: Iterable[PaperCase]) -> list[Curve]:
    """Return the sweeps of the cases, each once."""
    return list(dict.fromkeys(curve for case in cases for curve in case.curves))
