"""Manufactured solutions through FreeFEM and the checker: orders in space and time of every term, and wrong scripts."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from told import FLUID, SOLID, renamed, replaced, told, write
from told_scenes import EXACT, LABELS, WAVES, meshes, scene_in_time

from ffsi.files.arrays import read_mesh, read_state
from ffsi.freefem import FreeFEMError, run_script
from ffsi.reference import check
from ffsi.reference.from_scene import problem_from_scene


@pytest.fixture
def run_of(installation, tmp_path) -> Callable[..., tuple]:
    """Run from 0 to the end in so many steps; return the scene, the folder and how it went."""

    def run_of(kind, solution, n, steps, end, right="", wrong="", **settings):
        scene = scene_in_time(tmp_path, kind, end / steps, end, **settings)
        text = replaced(told(scene), right, wrong) if right else told(scene)
        out = tmp_path / f"{n}-{steps}"
        out.mkdir()
        (out / "case.edp").write_text(text, encoding="utf-8")
        write(out, solution, meshes(kind)(n), np.linspace(0, end, steps + 1), LABELS.get(kind, {}))
        done = run_script(
            out / "case.edp", {"out": out}, installation=installation, log=out / "log", cwd=out, time_limit=60
        )
        return scene, out, done

    return run_of


@pytest.fixture
def errors_of(run_of, monkeypatch) -> Callable[..., dict[tuple[int, str], float]]:
    """Return the L2 errors at the end by region and field; the checker, which is told the sources, too, agrees."""

    def errors_of(kind, solution, n, steps, end, **settings):
        scene, out, done = run_of(kind, solution, n, steps, end, **settings)
        assert done.status == "converged", done.reason
        mesh, k = read_mesh(out / "mesh.bin"), end / steps
        if steps < 16:
            assert judged(monkeypatch, kind, solution, scene, out) == []
        # An implicit pressure is that of t_n + theta k, one that follows from J is that of the end.
        between = end if kind == "mixed" else end - k + scene.time.theta_of(k) * k
        return solution.errors(mesh, read_state(out / "point-0001.bin", mesh), end, between)

    return errors_of


def judged(monkeypatch, kind, solution, scene, out) -> list[str]:
    """What the checker has to say of a run."""
    mesh = renamed(read_mesh(out / "mesh.bin"), {theirs: own for own, theirs in LABELS.get(kind, {}).items()})
    problem = replace(problem_from_scene(scene), manufactured=solution.manufactured(mesh))
    monkeypatch.setattr(check, "problem_from_scene", lambda scene: problem)
    return check.check_run(out, scene).failures


def orders(coarse, fine):
    """Orders by region and field from a run to one of half the size or step, where errors are more than rounding."""
    return {key: float(np.log2(coarse[key] / fine[key])) for key in fine if coarse[key] > 1e-12}


def orders_in_time(errors_of, kind, **settings):
    return orders(*(errors_of(kind, EXACT[kind], 2, steps, 0.4, **settings) for steps in (8, 16)))


@pytest.mark.parametrize("kind", WAVES)
def test_orders_in_space(kind, errors_of):
    runs = [errors_of(kind, WAVES[kind], n, steps, 0.2) for n, steps in ((4, 10), (8, 20))]
    found = orders(*runs)
    if kind == "openings":  # whose displacements the elements hold exactly
        del found[FLUID, "u"], found[SOLID, "u"]
    assert found == pytest.approx({key: 2 if key[1] == "p" else 3 for key in found}, abs=0.25)


SCHEMES = {"shifted-crank-nicolson": 2, "backward-euler": 1}
IN_TIME = [(kind, scheme) for kind in EXACT for scheme in SCHEMES if kind != "openings"]  # not turned it is the same


@pytest.mark.parametrize(("kind", "scheme"), IN_TIME)
def test_orders_in_time(kind, scheme, errors_of):
    found = orders_in_time(errors_of, kind, scheme=scheme)
    if kind == "massless":  # its velocity is that of two steps of backward Euler at first
        del found[SOLID, "v"]
    assert found == pytest.approx(dict.fromkeys(found, SCHEMES[scheme]), abs=0.2)


def test_newtons_method_solves_the_same_steps(errors_of):
    found = orders_in_time(errors_of, "both", scheme="crank-nicolson", solver="newton")
    assert found == pytest.approx(dict.fromkeys(found, 2), abs=0.2)


# Kind, and a wrong sign, factor or state of a term.
SIGNS = {
    "pressure on the new surface": ("both", "work = timeTheta*F11; work += oldF11;", "work = F11;"),
    "pressure of a solid on its new surface": ("incompressible",
        "G(:, k) *= timeTheta; G(:, k) += solidOldGradient[s](:, k);", "G(:, k) *= 1;"),
    "no mesh velocity": ("both", "meshVX *= 1/timeK;", "meshVX = 0;"),
    "J of the new state": ("both", "fluidDensity*(1-timeTheta)*oldJ;", "fluidDensity*(1-timeTheta)*fluidJ;"),
    "stress of the new state": ("solid", "solidSecond[s] *= timeTheta; solidSecond[s] += solidOldSecond[s];", ""),
    "no outlet's term of the old state": ("both", "(outletXY, 1-timeTheta,", "(outletXY, 0,"),
    "convection": ("both", "S11 += G12.*relativeY;", "S11 -= G12.*relativeY;"),
    "traction": ("linear", "loadForceX += loadPart; loadPart = p", "loadForceX -= loadPart; loadPart = p"),
    "pressure": ("linear", "loadNormalY[j]; loadForceY -=", "loadNormalY[j]; loadForceY +="),
    "a pressure that follows": ("linear", "AddProduct(loadTurn[j], p, mean", "AddProduct(loadTurn[j], -p, mean"),
    "a load in time": ("linear", "SetLoadFactors(timeNow+timeTheta*timeK);", "SetLoadFactors(timeNow+timeK);"),
    "a force's place": ("linear", "px = pointX[", "px = pointY["),
    "springs": ("linear", "= stiffness[j];", "= -stiffness[j];"),
    "old springs": ("linear", "AddProduct(springs, 1-timeTheta", "AddProduct(springs, timeTheta-1"),
    "dampers": ("linear", "= damping[j];", "= -damping[j];"),
    "old dampers": ("linear", "AddProduct(dampers, 1-timeTheta", "AddProduct(dampers, timeTheta-1"),
    "viscosity": ("plane stress", "*SolidViscosity(s)/timeK", "*SolidViscosity(s)/(-timeK)"),
    "viscosity, transposed": ("plane stress", "mean(:, r+i).*change(:, r+j)", "mean(:, r+j).*change(:, r+i)"),
    "damping of the mass": ("plane stress", "damping = timeTheta*massDamping", "damping = -timeTheta*massDamping"),
    "old damping": ("plane stress", "AddProduct(massDamping, 1-timeTheta", "AddProduct(massDamping, timeTheta-1"),
    "weight": ("plane stress", "(-loadFactor*gravityX, solidMass", "(loadFactor*gravityX, solidMass"),
    "plane stress": ("plane stress", "+2*(solidBlockLameMu)", "-2*(solidBlockLameMu)"),
    "linear elastic": ("linear", "shear += a(:, 2); shear *= mu", "shear -= a(:, 2); shear *= mu"),
    "weight of the fluid": ("openings", "S22 -= gravityY", "S22 += gravityY"),
    "hydrostatic": ("openings", "AddMomentum(loadFactor, hydrostaticX", "AddMomentum(-loadFactor, hydrostaticX"),
    "pressure behind": ("openings", "AddPressure(behind, openingDof[j]", "AddPressure(-behind, openingDof[j]"),
    "resistance": ("openings", "AddResistance(stepWeight*resistance[j],", "AddResistance(-stepWeight*resistance[j],"),
    "old flow": ("openings", "AddOpenings(1, 1-timeTheta", "AddOpenings(1, timeTheta-1"),
    "openings in time": ("openings", "OpeningFactors(timeNow+timeTheta*timeK);", "OpeningFactors(timeNow+timeK);"),
    "reservoir": ("openings", "StepReservoirs(oldX, X);", "StepReservoirs(X, X);"),
    "its balance": ("openings", "(flow + d*openingFactor[j]", "(flow - d*openingFactor[j]"),
    "what is in it": ("openings", "(1-timeTheta)*openingReservoir[j];", "timeTheta*openingReservoir[j];"),
    "backflow": ("openings", "min(outflowNormal, 0.)*outflowVX*b", "max(outflowNormal, 0.)*outflowVX*b"),
    "slip": ("openings", "Hold(slipAcrossY, ofVy)", "Hold(slipAcrossY, ofVx)"),
    "a mesh that slides": ("openings", "Hold(slipAcrossY, ofUy)", "Hold(slipAcrossY, ofUx)"),
    "inclined slip": ("turned", "-normalX[i]/normalY[i]", "normalX[i]/normalY[i]"),
    "its equations": ("turned", "rows[tiedTo[tied[i]]] += tieFactor", "rows[tiedTo[tied[i]]] -= tieFactor"),
    "rotation": ("spinning", "v *= -rotation[j]", "v *= rotation[j]"),
    "translation": ("spinning", "v += alongX[j]", "v -= alongX[j]"),
    "level": ("spinning", "meanPressure - loadFactor*", "meanPressure + loadFactor*"),
    "mean": ("spinning", "meanWeight *= 1/meanWeight.sum;", "meanWeight *= 1.001/meanWeight.sum;"),
    "displaced wall": ("tilting", "if (what == 1) return ", "if (what == 1) return -"),
    "its velocity": ("tilting", "if (what == 3) return ", "if (what == 3) return -"),
}  # fmt: skip


@pytest.mark.parametrize(("kind", "right", "wrong"), SIGNS.values(), ids=SIGNS)
def test_one_wrong_sign_is_caught(kind, right, wrong, run_of, monkeypatch):
    try:
        scene, out, done = run_of(kind, EXACT[kind], 2, 2, 0.2, right, wrong)
    except FreeFEMError as error:  # a singular matrix is as good as no convergence
        assert error.kind in ("singular-matrix", "mumps", "floating-point")
        return
    assert done.status == "failed" or judged(monkeypatch, kind, EXACT[kind], scene, out)
