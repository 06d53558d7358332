"""What the scene's names for regions and boundaries of a mesh file mean."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from ffsi.scene.boundaries import CLAMPED, INLET, LOADED, OUTER, OUTLET, SUPPORTED, WALLS, Role
from ffsi.scene.errors import Problem, names, nearest, short
from ffsi.scene.meshes.reading import Group

Names = tuple[str, ...]

FLUID = 1


@dataclass(frozen=True)
class RoleOf:
    """What a key of the scene's table of boundaries means.

    Args:
        role: condition on the boundary.
        label: its label.
        fluid: whether it is a boundary of the fluid (or of a solid).
    """

    role: Role
    label: int
    fluid: bool


ROLES: dict[str, RoleOf] = {
    "inlet": RoleOf("inlet", INLET, True),
    "outlet": RoleOf("outlet", OUTLET, True),
    "walls": RoleOf("no-slip", WALLS, True),
    "clamped": RoleOf("clamped", CLAMPED, False),
    "free": RoleOf("free", OUTER, False),
    "loaded": RoleOf("loaded", LOADED, False),
    "supported": RoleOf("free", SUPPORTED, False),
}


@dataclass(frozen=True)
class Naming:
    """The scene's names for what is in the file, in the scene's order.

    Args:
        regions: for "fluid" and each solid, names or numbers of regions in the file.
        boundaries: for each key of `ROLES`, names or numbers of boundaries in the file.
        parts: for each body part the same.
    """

    regions: tuple[tuple[str, Names], ...]
    boundaries: tuple[tuple[str, Names], ...]
    parts: tuple[tuple[str, Names], ...]

    @property
    def numbers(self) -> dict[str, int]:
        """Number of each region: 1 for the fluid, 2 and on for the solids."""
        solids = [name for name, _ in self.regions if name != "fluid"]
        return {name: FLUID if name == "fluid" else solids.index(name) + 2 for name, _ in self.regions}


def chosen_groups(
    wanted: Names, groups: Sequence[Group], key: str, noun: str, problems: list[Problem]
) -> list[tuple[str, Group]]:
    """Return the groups that the scene names, all those with a name; what is not there or empty becomes a problem."""
    found = []
    for name in wanted:
        called = [group for group in groups if group.name == name]
        numbered = [group for group in groups if str(group.number) == name and group.name != name]
        if called and numbered:
            text = f"means two: a {noun} with this name, and one with this number, which has"
            problems.append(Problem(key, f"{text} the name {names([numbered[0].title])}", short(name)))
            continue
        called = called or numbered
        if filled := [group for group in called if len(group.cells)]:
            found += [(name, group) for group in filled]
            continue
        titles = [group.title for group in groups if len(group.cells)]
        plural = "regions" if noun == "region" else "boundaries"
        hint = "(in Gmsh: physical groups, and Mesh.SaveAll = 0)"
        holds = f"the mesh has {names(titles)}" if titles else f"the mesh names no {plural} {hint}"
        if called:
            problems.append(
                Problem(key, f"the file names this {noun}, but nothing belongs to it; {holds}", short(name))
            )
        else:
            problems.append(Problem(key, f"no such {noun}; {holds}", short(name), nearest(str(name), titles)))
    return found
