"""Meshes made for quantities of a steady scene: what may be asked for, as arguments of the script."""

from __future__ import annotations

from collections.abc import Sequence

from ffsi.files.arguments import count_of, texts_of
from ffsi.files.errors import InputError
from ffsi.scene import Scene, boundaries, with_values
from ffsi.script.quantities import reported
from ffsi.script.render import has_sizes
from ffsi.text import nearest

Tolerance = float | str


def asked_of(
    scene: Scene, adapt: Sequence[str], tolerance: Tolerance | None, unknowns: int | None
) -> tuple[Scene, dict[str, str]]:
    """Return the scene that a run with a mesh made for quantities begins with, and what its script is asked for.

    Args:
        scene: the scene.
        adapt: names of quantities; without any there must be neither a tolerance nor a number of unknowns.
        tolerance: of each quantity, relative, above 0 and below 1; a text may be in "%".
        unknowns: the most that the mesh may have.

    Raises:
        InputError: an argument is not accepted, or no mesh of the scene can be made for a quantity.
    """
    names = texts_of(adapt, "adapt")
    if not names:
        if tolerance is not None or unknowns is not None:
            raise InputError("tolerance and unknowns belong to adapt, the quantities that the mesh is made for")
        return scene, {}
    if scene.time is not None:
        raise InputError(f"adapt: {scene.name} is a scene in time; accepted: steady ones")
    if not has_sizes(scene):
        kind = scene.geometry.kind
        raise InputError(f"adapt: the mesh of geometry.kind = {kind!r} has no sizes that could be changed")
    accepted = goals(scene)
    for name in names:
        if name not in accepted:
            guess = nearest(name, accepted)
            more = f'; did you mean "{guess}"?' if guess else ""
            raise InputError(
                f"adapt: {name!r} is no quantity that a mesh of this scene can be made for{more}; "
                f"accepted: {', '.join(accepted)}"
            )
    if tolerance is None and unknowns is None:
        raise InputError("adapt: give tolerance, such as 0.1%, or unknowns, the most that the mesh may have")
    asked = {"adapt": ",".join(names)}
    if tolerance is not None:
        asked["tolerance"] = repr(_fraction(tolerance))
    if unknowns is not None:
        asked["unknowns"] = str(count_of(unknowns, "unknowns"))
    return with_values(scene, {"mesh.level": 0}), asked


def goals(scene: Scene) -> list[str]:
    """Return the quantities of a scene that its mesh can be made for."""
    found = []
    if scene.fluid is not None:
        wet = ("inlet", "outlet", "no-slip", "interface", "slip")
        parts = [boundary.part for boundary in boundaries(scene) if boundary.part and boundary.role in wet]
        endings = ["", "_coefficient", *(f"_{part}" for part in parts if len(parts) > 1)] if parts else []
        found += [f"{force}{ending}" for ending in endings for force in ("drag", "lift")]
        found += [quantity.name for quantity in reported(scene) if quantity.name == "pressure_drop"]
    if scene.solid:
        found += [f"{place}_{axis}" for place in ("tip", *scene.probes) for axis in ("ux", "uy")]
    return found


def _fraction(tolerance: Tolerance) -> float:
    text = str(tolerance).strip()
    try:
        value = float(text.removesuffix("%")) / (100 if text.endswith("%") else 1)
    except ValueError:
        value = 0.0
    if isinstance(tolerance, bool) or not 0 < value < 1:
        raise InputError(f"tolerance = {tolerance!r}: accepted: a number above 0 and below 1, or a text such as '0.1%'")
    return value
