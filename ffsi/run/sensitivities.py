"""Derivatives of the quantities of a scene by its parameters, as a table."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from ffsi.files.arguments import path_of, texts_of
from ffsi.files.errors import InputError
from ffsi.freefem.events import OnEvent
from ffsi.hemodynamics.result import Result
from ffsi.run.adaptation import goals
from ffsi.run.one_scene import solve
from ffsi.scene import Scene, scene_of
from ffsi.script.quantities import QUANTITIES, reported
from ffsi.script.render import parameters
from ffsi.text import nearest

_CHANGE = 0.01
"""By which part of itself a parameter is changed to either side, in time."""
_ENDINGS = ("_mean", "_amplitude", "_frequency", "_last", "_min", "_max")

if TYPE_CHECKING:
    import pandas as pd


def sensitivities(
    scene: Scene | str | Path | Result,
    of: Iterable[str] = (),
    to: Iterable[str] = (),
    out: str | Path | None = None,
    *,
    logarithmic: bool = False,
) -> pd.DataFrame:
    """Return the derivatives of quantities by parameters, at the steady state of a scene or of its motion in time.

    In time they are differences of two runs for each parameter, a hundredth of it to either side (`differences`).

    Args:
        scene: a scene, the name of a case, the path of a TOML file; or a Result of `solve(..., sensitivities=True)`.
        of: names of quantities that the script reports; all without any.
        to: dotted keys of the scene's numbers that keep the mesh; all without any, but in time some are needed.
        out: the run folder, as of `solve`.
        logarithmic: p/J dJ/dp instead, without dimension; NaN where J is 0.

    Returns:
        Rows keys, columns quantities: dJ/dp in SI, all other numbers of the scene held.

    Raises:
        InputError: an unknown name, or a state that was not reached or not believed by the checker.
        SceneError, FreeFEMNotFound, FreeFEMError: as `solve`.
    """
    import pandas as pd

    of, to = texts_of(of, "of"), texts_of(to, "to")
    if isinstance(scene, Result) and "sensitivities" in scene.data:
        result = scene
    else:
        target = None if out is None else path_of(out, "out")
        asked = scene.scene if isinstance(scene, Result) else scene_of(scene)
        refuse_unknown(asked, of, to)
        if asked.time is not None:
            return differences(asked, of, to, target)[logarithmic]
        result = solve(asked, target, sensitivities=True)
    if not result.converged:
        raise InputError(f"no sensitivities: {result.reason}")
    found = result.data["sensitivities"]
    part = "logarithmic" if logarithmic else "derivative"
    columns = _known(of, list(found), "quantity")
    keys = list(next(iter(found.values())))
    table = {name: {key: found[name][key][part] for key in _known(to, keys, "parameter")} for name in columns}
    return pd.DataFrame(table, dtype=float)


def differences(
    scene: Scene, of: Sequence[str], to: Sequence[str], out: Path | None = None, on_event: OnEvent | None = None
) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Return derivatives and logarithmic ones of a scene in time: central differences of runs, a sweep in `out`.

    Of means, amplitudes, frequencies, extrema and last values. An error of a quantity that both runs have cancels; what
    is left is theirs, magnified by fifty, beside that of the difference, of the order of a ten-thousandth.

    Raises:
        InputError: no parameter, one that is 0, an unknown name, or a run that was not solved.
    """
    from ffsi.run.sweep import sweep

    keys, values = list(to), scene.parameters()
    if not keys:
        raise InputError("sensitivities in time: every number costs two runs; name those that are wanted (to, --to)")
    if zero := [key for key in keys if not values[key]]:
        raise InputError(f"{zero[0]} = 0: in time a number is changed by a hundredth of it; accepted: others than 0")
    middle = {key: float(values[key]) for key in keys}
    points = [{**middle, key: middle[key] * (1 + sign * _CHANGE)} for key in keys for sign in (1, -1)]
    with tempfile.TemporaryDirectory(prefix="ffsi-sensitivities-") as temporary:
        table = sweep(scene.settled(), points, out or temporary, jobs=os.cpu_count(), on_event=on_event)
    for reason in table["reason"][table["status"] != "converged"]:
        raise InputError(f"no sensitivities: {reason}")
    known = [name for name in map(str, table) if name.endswith(_ENDINGS) and not name.startswith("min_jacobian")]
    names = _known(of, known, "quantity")
    up, down = table[names].iloc[::2].set_axis(keys), table[names].iloc[1::2].set_axis(keys)
    logarithmic = (up - down) / (_CHANGE * (up + down))
    return (up - down).div([2 * _CHANGE * middle[key] for key in keys], axis=0), logarithmic


def refuse_unknown(scene: Scene, of: Sequence[str], to: Sequence[str]) -> None:
    """Refuse names that no run of the scene has, before one starts; raises InputError.

    Quantities of parts and their other forms have the name of a quantity in front: `drag_beam_surface`.
    """
    accepted = sorted({quantity.name for quantity in QUANTITIES})
    later = tuple(f"{name}_" for name in accepted)  # what tells a name apart is known after the run
    if scene.time is not None:
        accepted = [f"{name}{ending}" for name in _of_history(scene) for ending in _ENDINGS]
        later = tuple(each.name for each in QUANTITIES if {"walls", "parts"} & {*each.tables})
    _known([name for name in of if not name.startswith(later)], accepted, "quantity")
    numbers = {parameter.key: parameter for parameter in parameters(scene) if parameter.kind == 1}
    _known(to, [*numbers], "parameter")
    for number in (numbers[key] for key in to):
        if number.value in number.limits.bounds.values():
            text = f"an end of what is accepted ({number.limits.range}): it has no differences to both sides"
            raise InputError(f"{number.key} = {number.value:g} is {text}")


def _of_history(scene: Scene) -> list[str]:
    """Return the quantities of every step of a scene in time, those of walls and energies apart."""
    names = [name for name in goals(scene) if name in ("drag", "lift", "tip_ux", "tip_uy")]
    if "drag" in names and scene.forces and scene.inflow and scene.inflow.mean_velocity:
        names += ["drag_coefficient", "lift_coefficient"]
    if scene.only_outlet and scene.only_outlet.has_pressure:
        names += ["flow_rate_out", "outlet_pressure"]
    return [*names, *(quantity.name for quantity in reported(scene) if quantity.history)]


def _known(names: Sequence[str], accepted: Sequence[str], what: str) -> Sequence[str]:
    for name in names:
        if name not in accepted:
            guess = nearest(name, accepted)
            more = f'; did you mean "{guess}"?' if guess else f"; accepted: {', '.join(accepted)}"
            raise InputError(f"{name!r} is no {what} with sensitivities of this scene{more}")
    return names or accepted
