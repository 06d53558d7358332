"""The equations in their spatial form, differentiated numerically: sources of manufactured solutions.

Nothing here comes from a template or from the checker. The fluid's sources are those of Navier-Stokes at the moving
points x = X + u, which know nothing of a mesh: F, J and the mesh velocity enter only by where the points are.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

DENSITY, VISCOSITY = 1.3, 0.05
SOLID_DENSITY, LAMBDA, MU = 2.0, 6.0, 3.0
TINY, WIDTH = 1e-30, 0.05
# Central differences of order 8: at this width exact to 1e-14, and analytic, so that a complex step passes through.
WEIGHTS = np.array([4 / 5, -1 / 5, 4 / 105, -1 / 280])


def gradient(function, points):
    """Derivatives of (n, ...) values by the coordinates, (n, ..., 2)."""
    columns = []
    for unit in np.eye(2):
        pairs = [function(points + m * WIDTH * unit) - function(points - m * WIDTH * unit) for m in range(1, 5)]
        columns.append(sum(w * pair for w, pair in zip(WEIGHTS, pairs, strict=True)) / WIDTH)
    return np.stack(columns, axis=-1)


def divergence(function, points):
    """Row divergence (n, 2) of a tensor field (n, 2, 2)."""
    return sum(function(points + 1j * TINY * unit)[..., j].imag / TINY for j, unit in enumerate(np.eye(2)))


def rate(function, t):
    return function(t + 1j * TINY).imag / TINY


def spherical(values):
    return values[:, None, None] * np.eye(2)


def cofactor(f):
    return np.stack([np.stack([f[:, 1, 1], -f[:, 1, 0]], -1), np.stack([-f[:, 0, 1], f[:, 0, 0]], -1)], axis=1)


def det(f):
    return f[:, 0, 0] * f[:, 1, 1] - f[:, 0, 1] * f[:, 1, 0]


def vector(*components):
    return np.stack(np.broadcast_arrays(*components), axis=-1)


@dataclass(frozen=True)
class Swing:
    """Amplitude 0.2 sin(2 t + phase) and its rate."""

    phase: float

    def __call__(self, t):
        return 0.2 * np.sin(2.0 * t + self.phase)

    def rate(self, t):
        return 0.4 * np.cos(2.0 * t + self.phase)


SWINGING = Swing(0.3)  # neither at rest nor at its largest at either end of a run


def beating(t):
    return 1.0 + 0.5 * np.sin(3.0 * t)


def waves(x):
    return vector(np.sin(1.5 * x[:, 0] + x[:, 1]), np.cos(x[:, 0] - 1.2 * x[:, 1]))


def parabolas(x):
    a, b = x.T
    return vector(a**2 - 0.5 * a * b + b, 0.3 * b**2 + a * b - 0.4 * a)


def planes(x):
    return 0.7 - 0.5 * x[:, 0] + 0.9 * x[:, 1]


@dataclass(frozen=True)
class Exact:
    """Exact fields: u of X; velocity and pressure of the fluid of the place x; velocity and pressure of the solid of X.

    ``viscosity`` is a function of the squared shear rate, ``far_viscosity`` the one of the outlet's condition. A solid
    with a pressure of its own is neo-Hookean, whose pressure stands for all that resists a change of volume; any other
    is of St. Venant and Kirchhoff or ``linear_elastic``, with ``lame_lambda`` and damping of stress and momentum.
    """

    u: Callable
    velocity: Callable = None
    p: Callable = None
    solid_velocity: Callable = None
    solid_pressure: Callable = None
    viscosity: Callable = lambda squared: VISCOSITY + 0.0 * squared
    far_viscosity: float = VISCOSITY
    hyperelastic_mesh: bool = False
    gravity: tuple[float, float] = (0.0, 0.0)
    linear_elastic: bool = False
    solid_density: float = SOLID_DENSITY
    lame_lambda: float = LAMBDA
    solid_viscosity: float = 0.0
    mass_damping: float = 0.0

    def turned(self, turn):
        """The same where the points (n, 2), as rows, are multiplied by a rotation."""

        def field(of):
            return of and (lambda x, t: of(x @ turn.T, t) @ turn)

        return replace(
            self, u=field(self.u), velocity=field(self.velocity), solid_velocity=field(self.solid_velocity),
            p=self.p and (lambda x, t: self.p(x @ turn.T, t)), gravity=tuple(self.gravity @ turn),
        )  # fmt: skip

    def place(self, x, t):
        return x + self.u(x, t)

    def deformation(self, x, t):
        return np.eye(2) + gradient(lambda z: self.u(z, t), x)

    def v(self, x, t):
        """Velocity of the fluid at reference points."""
        return self.velocity(self.place(x, t), t)

    def cauchy(self, x, t):
        g = gradient(lambda z: self.velocity(z, t), x)
        twice = g + g.swapaxes(1, 2)
        return -spherical(self.p(x, t)) + self.viscosity((twice**2).sum(axis=(1, 2)) / 2)[:, None, None] * twice

    def fluid_force(self, x, t):
        place, jacobian = self.place(x, t), det(self.deformation(x, t))
        g = gradient(lambda z: self.velocity(z, t), place)
        acceleration = rate(lambda s: self.velocity(place, s), t) + np.einsum("nij,nj->ni", g, self.velocity(place, t))
        return jacobian[:, None] * (
            DENSITY * (acceleration - self.gravity) - divergence(lambda z: self.cauchy(z, t), place)
        )

    def fluid_stress(self, x, t):
        return self.cauchy(self.place(x, t), t) @ cofactor(self.deformation(x, t))

    def outlet_stress(self, x, t):
        """What a do-nothing outlet leaves over, on the reference boundary: -p + mu grad v for a Newtonian fluid."""
        place = self.place(x, t)
        g = gradient(lambda z: self.velocity(z, t), place)
        transposed = g.swapaxes(1, 2) - spherical(np.trace(g, axis1=1, axis2=2))
        return (self.cauchy(place, t) - self.far_viscosity * transposed) @ cofactor(self.deformation(x, t))

    def mass(self, x, t):
        g = gradient(lambda z: self.velocity(z, t), self.place(x, t))
        return det(self.deformation(x, t)) * np.trace(g, axis1=1, axis2=2)

    def mesh_stress(self, x, t, weight):
        """That of a mesh motion with this weight of div u or ln J, of stiffness 1."""
        g = gradient(lambda y: self.u(y, t), x)
        if self.hyperelastic_mesh:
            f = np.eye(2) + g
            return f + ((weight * np.log(det(f)) - 1) / det(f))[:, None, None] * cofactor(f)
        return g + weight * spherical(np.trace(g, axis1=1, axis2=2))

    def mesh_force(self, x, t, weight):
        return -divergence(lambda z: self.mesh_stress(z, t, weight), x)

    def solid_stress(self, x, t):
        f = self.deformation(x, t)
        if self.solid_pressure is not None:
            return MU * f - spherical(self.solid_pressure(x, t) + MU / det(f)) @ cofactor(f)
        rates = f.swapaxes(1, 2) @ gradient(lambda z: self.solid_velocity(z, t), x)
        damped = self.solid_viscosity * 0.5 * (rates + rates.swapaxes(1, 2))
        squared = f + f.swapaxes(1, 2) - np.eye(2) if self.linear_elastic else f.swapaxes(1, 2) @ f
        strain = 0.5 * (squared - np.eye(2))
        stress = self.lame_lambda * spherical(np.trace(strain, axis1=1, axis2=2)) + 2 * MU * strain
        return stress + f @ damped if self.linear_elastic else f @ (stress + damped)

    def solid_force(self, x, t):
        damped = self.mass_damping * self.solid_velocity(x, t) - self.gravity
        inertia = self.solid_density * (rate(lambda s: self.solid_velocity(x, s), t) + damped)
        return inertia - divergence(lambda z: self.solid_stress(z, t), x)


def assert_derivative(stress, energy, gradients, tolerance=1e-14):
    """Compare P (n, 2, 2) with the derivative of an energy by the displacement's gradient, by complex steps."""
    for i, j in np.ndindex(2, 2):
        step = np.zeros((2, 2), dtype=complex)
        step[i, j] = 1e-30j
        derivative = energy(gradients + step).imag / 1e-30
        np.testing.assert_allclose(stress[:, i, j], derivative, rtol=0, atol=tolerance * np.abs(stress).max())
