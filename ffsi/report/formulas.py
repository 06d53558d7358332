"""Where the paper's formulas differ from the standard ones: what it prints and what is computed, for every report.

The texts, in templates/remarks.toml, are fragments of HTML that Markdown accepts too.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import Any

from ffsi.hemodynamics.result import Result
from ffsi.report.tables import value_text
from ffsi.result.quantities import flatten
from ffsi.scene import Scene
from ffsi.scene.materials import MooneyRivlin, NeoHookean, StVenantKirchhoff

LAWS = {StVenantKirchhoff: "St. Venant-Kirchhoff", NeoHookean: "neo-Hookean", MooneyRivlin: "Mooney-Rivlin"}


@dataclass(frozen=True)
class Remark:
    """One difference: what the paper prints, and what is computed here."""

    topic: str
    paper: str
    here: str


def is_paper_case(scene: Scene) -> bool:
    """Tell whether the scene is a flap in a channel, the paper's sections 5.1 to 5.3."""
    return scene.geometry.kind == "flap-channel" and scene.fluid is not None and scene.forces is not None


def remarks(scene: Scene) -> list[Remark]:
    """Return what differs between the paper and the computation of one of its cases; empty for other scenes."""
    if not is_paper_case(scene):
        return []
    assert scene.fluid is not None and scene.forces is not None
    texts, density = _file()["texts"], scene.fluid.density
    values: dict[str, Any] = {
        "density": density,
        "of_density": texts["same_density" if density == 1 else "other_density"],
        "height": scene.forces.reference_length,
    }
    tags: set[str] = set()
    if (flap := scene.solid.get("flap")) is not None and type(flap) in LAWS:
        young, poisson = flap.young_poisson
        values |= {"law": LAWS[type(flap)], "young": young, "shear": flap.lame[1], "ratio": _signed(poisson, ".2g")}
        values |= {"finer_ratio": _signed(poisson, ".3g"), "of_bulk": texts["slip"] if poisson < 0 else ""}
        tags = {flap.material, "incompressible" if flap.incompressible else "compressible"}
        if isinstance(flap, MooneyRivlin) and flap.bulk_modulus is not None:
            values["bulk"] = flap.bulk_modulus
            tags.add("bulk")
    found = [item for item in _file()["remark"] if tags.issuperset(item["when"])]
    return [Remark(item["topic"], item["paper"], item["here"].format(**values)) for item in found]


def force_difference(values: Mapping[str, float]) -> str:
    """Return how far the two forms of the drag are apart, in words; empty if there are not both."""
    if not values.get("drag") or "drag_surface" not in values:
        return ""
    return f"The two forms of the drag are {100 * abs(values['drag_surface'] / values['drag'] - 1):.2f} % apart here."


def solid_remark(result: Result) -> str:
    """Return what limits the St. Venant-Kirchhoff flap, with this point's smallest J; empty for other solids."""
    if not isinstance(result.scene.solid.get("flap"), StVenantKirchhoff):
        return ""
    text = (
        "St. Venant-Kirchhoff loses all resistance in strong compression: at the flap's downstream root corner the "
        "solid collapses (J → 0), and the earlier the finer the root is resolved. The element size there belongs to "
        "the case"
    )
    size = result.scene.mesh.root_size
    text += f" ({size:g} m here)." if size is not None else "."
    smallest = flatten(result.quantities).get("min_jacobian_solid")
    if smallest is None:
        return text
    at = "".join(f" at {key} = {value_text(value)}" for key, value in (result.data.get("varied") or {}).items())
    return f"{text} Smallest J in the solid{at}: {smallest:.3f}."


@cache
def _file() -> dict[str, Any]:
    return tomllib.loads(files("ffsi.report").joinpath("templates/remarks.toml").read_text(encoding="utf-8"))


def _signed(value: float, form: str) -> str:
    return format(value, form).replace("-", "−")
