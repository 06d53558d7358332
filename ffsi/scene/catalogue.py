"""The catalogue: scenes with published or stated values."""

from __future__ import annotations

from ffsi.scene.flow import Forces, Inflow
from ffsi.scene.fluids import Carreau, Fluid, Newtonian
from ffsi.scene.geometry import (
    Aneurysm,
    Beam,
    Cantilever,
    ChannelCavity,
    ChannelCylinder,
    CookMembrane,
    FlapChannel,
    Roof,
)
from ffsi.scene.loads import Gravity, Support, Traction
from ffsi.scene.materials import MooneyRivlin, NeoHookean, Solid, StVenantKirchhoff
from ffsi.scene.model import Scene
from ffsi.scene.numerics import Mesh, MeshMotion, Output, WallOutput
from ffsi.scene.outlet import Outlet
from ffsi.scene.time import Time

# St. Venant-Kirchhoff collapses at a finely resolved root corner: the size there belongs to the scene.
FLAP_SVK_MESH = Mesh(level=1, root_size=0.01)
FLAP_MESH = Mesh(level=1)
# Element sizes at level 0 where the geometry's defaults are not the best: a flow needs the wake, a beam its corners.
FLOW_MESH = Mesh(growth=0.4, far_size=0.05, body_size=0.012, corner_size=0.0025)
CYLINDER_MESH = Mesh(growth=0.4, far_size=0.05, body_size=0.008, corner_size=0.0025)
CYLINDER_STREET_MESH = Mesh(growth=0.3, far_size=0.037, body_size=0.006, corner_size=0.0025)
SHEDDING_MESH = Mesh(growth=0.35, far_size=0.0435, body_size=0.0105, corner_size=0.0022)
FLUTTER_MESH = Mesh(growth=0.63, far_size=0.07, body_size=0.0125, corner_size=0.006)
BEAM_MESH = Mesh(growth=0.5, far_size=0.09, body_size=0.012, corner_size=0.001)

# What the walls of an aneurysm or a beam in a slow flow need: the cheapest one.
HARMONIC = MeshMotion(kind="harmonic", stiffness_exponent=1.0, distance_exponent=0.0, divergence_weight=1.0)
# Carries the beam to 85 mm with J above 0.5; a harmonic one ends below 0.1.
ELASTIC = MeshMotion(kind="linear-elastic", stiffness_exponent=1.0, distance_exponent=0.0, divergence_weight=16.0)
# Must follow a tip that moves by two thirds of the flap's height.
HYPERELASTIC = MeshMotion(kind="hyperelastic", stiffness_exponent=1.0, distance_exponent=0.0, divergence_weight=5.0)

DO_NOTHING = Outlet(kind="do-nothing")
BLOOD = Newtonian(density=1035.0, viscosity=3.5e-3)
PERIOD = 60 / 84
# The waveform's mean in the middle of the lumen, 0.357143 m/s, as a mean over the lumen; from rest within 0.2 s.
PULSE = Inflow(mean_velocity=0.357143 / 1.5, waveform="aneurysm-84bpm", ramp=0.2)


def flap(name: str, description: str, solid: Solid, mesh: Mesh, roof: Solid | None = None) -> Scene:
    """Return the elastic flap in a channel (Table 1 of the paper) with the given material and mesh.

    Args:
        name: name of the case.
        description: one line of text.
        solid: material of the flap.
        mesh: element sizes.
        roof: material of an elastic roof; None for a rigid one. The mean velocity is the last one of the paper's sweep.
    """
    return Scene(
        name=name,
        description=description,
        geometry=FlapChannel(roof=Roof() if roof else None),
        mesh=mesh,
        fluid=Newtonian(density=1.0, viscosity=1e-3),
        solid={"flap": solid, "roof": roof} if roof else {"flap": solid},
        mesh_motion=HYPERELASTIC,
        inflow=Inflow(mean_velocity=0.055 if roof else 0.12),
        outlet=DO_NOTHING,
        forces=Forces(reference_length=0.2),
    )


def turek(
    name: str,
    description: str,
    mean_velocity: float | None = None,
    lame_mu: float | None = None,
    density: float = 1000.0,
    time: Time | None = None,
) -> Scene:
    """Return a case of Turek and Hron's benchmark.

    Args:
        name: name of the case.
        description: one line of text.
        mean_velocity: of the inflow, m/s; None for the beam alone under gravity.
        lame_mu: shear modulus of the beam, Pa; None for a rigid beam.
        density: of the beam, kg/m^3.
        time: steps in time; None for a steady case. In time the inflow grows from rest within 2 s.
    """
    wet = mean_velocity is not None
    mesh = (SHEDDING_MESH if time else FLOW_MESH) if wet else BEAM_MESH
    solid = {}
    if lame_mu is not None:
        if wet:
            mesh = FLUTTER_MESH if time else Mesh()
        beam = StVenantKirchhoff(material="st-venant-kirchhoff", density=density, lame_mu=lame_mu, poisson_ratio=0.4)
        solid = {"beam": beam}
    return Scene(
        name=name,
        description=description,
        geometry=ChannelCylinder(beam=Beam()),
        mesh=mesh,
        fluid=Newtonian(density=1000.0, viscosity=1.0) if wet else None,
        solid=solid,
        gravity=None if wet else Gravity(y=-2.0),
        mesh_motion=(ELASTIC if time else HARMONIC) if wet and solid else None,
        inflow=Inflow(mean_velocity=mean_velocity, ramp=2.0 if time else None) if wet else None,
        outlet=DO_NOTHING if wet else None,
        forces=Forces(reference_length=0.1) if wet else None,
        time=time,
    )


def cylinder(name: str, description: str, inflow: Inflow, time: Time | None = None) -> Scene:
    """Return a case of Schaefer and Turek's benchmark, a rigid cylinder in a channel.

    Args:
        name: name of the case.
        description: one line of text.
        inflow: velocity at the inlet.
        time: steps in time; None for a steady case.
    """
    return Scene(
        name=name,
        description=description,
        geometry=ChannelCylinder(length=2.2),
        mesh=CYLINDER_STREET_MESH if time else CYLINDER_MESH,
        fluid=Newtonian(density=1.0, viscosity=1e-3),
        inflow=inflow,
        outlet=DO_NOTHING,
        forces=Forces(reference_length=0.1),
        time=time,
    )


def aneurysm(name: str, description: str, fluid: Fluid, pulsatile: bool = False) -> Scene:
    """Return the flow of blood through an aneurysm with elastic walls.

    Args:
        name: name of the case.
        description: one line of text.
        fluid: the blood.
        pulsatile: four cycles at 84 beats per minute instead of a steady flow. The dome is softer then, as in the
            source of the geometry, and the tissue around the walls carries a part of the pressure.
    """
    wall = {"material": "neo-hookean", "formulation": "incompressible", "density": 1120.0}
    return Scene(
        name=name,
        description=description,
        geometry=Aneurysm(),
        fluid=fluid,
        solid={
            "vessel": NeoHookean.model_validate(wall | {"young_modulus": 1.0e6}),
            "dome": NeoHookean.model_validate(wall | {"young_modulus": 5.0e4 if pulsatile else 1.0e5}),
        },
        mesh_motion=HARMONIC if pulsatile else HYPERELASTIC,  # which goes between struts, for 4 % of the time
        inflow=PULSE if pulsatile else Inflow(mean_velocity=0.05 / 1.5),  # a peak of 0.05 m/s
        outlet=DO_NOTHING,
        support=Support(stiffness=5.0e5) if pulsatile else None,
        time=Time(step=PERIOD / 100, end=4 * PERIOD, output_interval=PERIOD / 10) if pulsatile else None,
        output=Output(wall=WallOutput()) if pulsatile else Output(),
    )


def periodic(step: float, end: float) -> Time:
    """Return time steps (s) until the motion is periodic, at the latest until `end` (s)."""
    return Time(step=step, end=end, stop="periodic")


def _scenes() -> list[Scene]:
    flap_text = "Elastic flap on the floor of a channel"
    svk = StVenantKirchhoff(material="st-venant-kirchhoff", density=1.0, lame_lambda=8.0, lame_mu=2.0)
    neo = NeoHookean(material="neo-hookean", formulation="displacement", density=1.0, lame_lambda=8.0, lame_mu=2.0)
    # The paper's bulk modulus, far below the shear modulus of 350 Pa: Poisson's ratio is about -0.93.
    mooney = MooneyRivlin(
        material="mooney-rivlin", formulation="displacement", density=1.0, c10=75.0, c01=100.0, bulk_modulus=5.6
    )
    floor = StVenantKirchhoff(material="st-venant-kirchhoff", density=1000.0, young_modulus=500.0, poisson_ratio=0.4)
    membrane = NeoHookean(
        material="neo-hookean", formulation="displacement", density=1.0, young_modulus=200.0, poisson_ratio=0.35
    )
    # Per metre of depth E h^3 / (12 (1 - nu^2)) = 109200 * 0.01^3 / (12 * 0.91) = 0.01 N m, and the load is
    # P = traction.y * h = traction.y * 0.01 m: the elastica's P L^2 / (E I) with L = 1 m is traction.y in Pa.
    cantilever = StVenantKirchhoff(
        material="st-venant-kirchhoff", density=1.0, young_modulus=109200.0, poisson_ratio=0.3
    )
    return [
        flap("flap-svk", f"{flap_text}, St. Venant-Kirchhoff, rigid roof", svk, FLAP_SVK_MESH),
        flap("flap-neo-hookean", f"{flap_text}, neo-Hookean, rigid roof", neo, FLAP_MESH),
        flap("flap-mooney-rivlin", f"{flap_text}, Mooney-Rivlin, rigid roof", mooney, FLAP_MESH),
        flap("flap-neo-hookean-roof", f"{flap_text}, neo-Hookean, elastic roof", neo, FLAP_MESH, svk),
        flap("flap-mooney-rivlin-roof", f"{flap_text}, Mooney-Rivlin, elastic roof", mooney, FLAP_MESH, svk),
        turek("turek-cfd1", "Turek-Hron CFD1: steady flow around a rigid cylinder and beam, Re 20", 0.2),
        turek("turek-cfd2", "Turek-Hron CFD2: steady flow around a rigid cylinder and beam, Re 100", 1.0),
        turek("turek-csm1", "Turek-Hron CSM1: beam under gravity", lame_mu=0.5e6),
        turek("turek-csm2", "Turek-Hron CSM2: stiffer beam under gravity", lame_mu=2.0e6),
        turek("turek-fsi1", "Turek-Hron FSI1: elastic beam in steady flow, Re 20", 0.2, 0.5e6),
        turek(
            "turek-cfd3",
            "Turek-Hron CFD3: vortex street behind a rigid cylinder and beam, Re 200",
            2.0,
            # Two blocks of periods agree within 2 % long before the amplitudes have come to rest.
            time=Time(step=0.005, end=12.0),
        ),
        turek(
            "turek-csm3",
            "Turek-Hron CSM3: beam swinging under gravity",
            lame_mu=0.5e6,
            time=periodic(step=0.005, end=10.0),
        ),
        turek(
            "turek-fsi2",
            "Turek-Hron FSI2: heavy elastic beam, large oscillations, Re 100",
            1.0,
            0.5e6,
            density=10000.0,
            time=periodic(step=0.01, end=15.0),
        ),
        turek(
            "turek-fsi3",
            "Turek-Hron FSI3: light elastic beam, fast oscillations, Re 200",
            2.0,
            2.0e6,
            time=periodic(step=0.005, end=10.0),
        ),
        cylinder(
            "cylinder-2d1", "Schaefer-Turek 2D-1: steady flow around a cylinder, Re 20", Inflow(mean_velocity=0.2)
        ),
        cylinder(
            "cylinder-2d2",
            "Schaefer-Turek 2D-2: vortex street behind a cylinder, Re 100",
            # The benchmark is the periodic state: how the flow grows into it is free, a jump at t = 0 would be noise.
            Inflow(mean_velocity=1.0, ramp=1.0),
            Time(step=0.0025, end=8.0),
        ),
        Scene(
            name="cavity-flexible-floor",
            description="Channel over a cavity with a flexible floor (Tukovic et al. 2018)",
            geometry=ChannelCavity(),
            fluid=Newtonian(density=1.0, viscosity=0.01),
            solid={"floor": floor},
            mesh_motion=HARMONIC,
            inflow=Inflow(mean_velocity=1.0),
            outlet=DO_NOTHING,
            forces=Forces(reference_length=1.0),
        ),
        aneurysm("aneurysm", "Aneurysm with elastic walls, steady flow, Newtonian blood", BLOOD),
        aneurysm(
            "aneurysm-carreau", "Aneurysm with elastic walls, steady flow, Carreau blood", Carreau(density=1035.0)
        ),
        aneurysm("aneurysm-pulsatile", "Aneurysm with elastic walls, pulsatile flow at 84 bpm", BLOOD, pulsatile=True),
        Scene(
            name="cook",
            description="Cook's membrane, neo-Hookean; other constants, materials and formulations by --set",
            geometry=CookMembrane(),
            solid={"membrane": membrane},
            traction=Traction(y=4.0),
        ),
        Scene(
            name="cantilever",
            description="Slender cantilever with a dead load at its tip (elastica)",
            geometry=Cantilever(),
            solid={"beam": cantilever},
            traction=Traction(y=1.0),
        ),
    ]


CASES: dict[str, Scene] = {scene.name: scene for scene in _scenes()}
STEADY_CASES: dict[str, Scene] = {name: scene for name, scene in CASES.items() if scene.steady}
