"""The aneurysm of the catalogue: steady and pulsatile, with elastic and rigid walls, Newtonian and Carreau blood."""

from __future__ import annotations

from dataclasses import dataclass

from ffsi.scene import CASES, Scene


@dataclass(frozen=True)
class AneurysmVariant:
    """One computation.

    Attributes:
        name: of its folder.
        pulsatile: whether the flow is.
        elastic: whether the walls are, else rigid.
        carreau: whether blood is a Carreau fluid, else Newtonian.
        held: whether the elastic walls of a steady flow have the support that those of the pulsatile one have.
    """

    name: str
    pulsatile: bool
    elastic: bool
    carreau: bool
    held: bool = False

    @property
    def label(self) -> str:
        """Name in legends and tables."""
        walls = "elastic" + (", held" if self.held else "") if self.elastic else "rigid"
        return f"{walls}, {'Carreau' if self.carreau else 'Newtonian'}"

    def scene(self, level: int) -> Scene:
        """Return the scene on a mesh level, without the pictures of a run."""
        table = CASES["aneurysm-pulsatile" if self.pulsatile else "aneurysm"].model_dump(exclude_none=True)
        table["name"] = f"aneurysm-{self.name}"
        table["mesh"]["level"] = level
        table["output"] |= {"pictures": False, "vtu": False}
        if self.carreau:
            table["fluid"] = CASES["aneurysm-carreau"].model_dump()["fluid"]
        if self.held:
            table["support"] = CASES["aneurysm-pulsatile"].model_dump()["support"]
        if self.pulsatile:
            # Twenty states per cycle: one of them is near the systole.
            table["time"]["output_interval"] = table["inflow"]["period"] / 20
        if not self.elastic:
            for key in ("solid", "mesh_motion", "support"):
                table.pop(key, None)
        return Scene.model_validate(table)


VARIANTS = tuple(
    AneurysmVariant(
        "-".join(
            ("pulsatile" if pulsatile else "steady", "elastic" if elastic else "rigid")
            + (("carreau",) if carreau else ())
        ),
        pulsatile,
        elastic,
        carreau,
    )
    for pulsatile in (False, True)
    for elastic in (True, False)
    for carreau in (False, True)
)
HELD = AneurysmVariant("steady-elastic-held", pulsatile=False, elastic=True, carreau=False, held=True)
