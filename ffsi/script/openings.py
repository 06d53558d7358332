"""Several inlets and outlets, and inlets with a pressure, for the templates: arrays with a value for each label."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from ffsi.scene import Boundary, Scene
from ffsi.scene.flow import Inlet
from ffsi.scene.outlet import Outlet
from ffsi.script.walls import arrays, camel


def has_openings(scene: Scene) -> bool:
    """Return whether several natural conditions are there, each with a pressure of its own behind it."""
    return bool(scene.outlets) or any(inlet.pressure is not None for inlet in scene.inlet.values())


def has_reservoirs(scene: Scene) -> bool:
    """Return whether what is behind one of several outlets stores fluid in time."""
    return scene.time is not None and any(outlet.law.stores for outlet in scene.outlets.values())


def openings(scene: Scene, outline: list[Boundary]) -> dict[str, Any]:
    """Return the macros of inlets and openings by name, and the profiles; nothing of scenes with one of each."""
    found: dict[str, Any] = {"inlets": {}, "openings": {}, "inlet_profiles": [], "inlet_factors": ""}
    found["largest_velocity"] = "0."
    if scene.inlet:
        factors = ", ".join(f"abs({_factor(scene, name)})" for name in scene.inlet)
        found["inlet_factors"] = f"[{factors}]" if scene.time else ""
        found["largest_velocity"] = _largest([
            f"abs({_variable('inlet', name, 'mean_velocity')})"
            for name, inlet in scene.inlet.items()
            if inlet.mean_velocity is not None
        ])  # fmt: skip
        found |= _inlets(scene, [side.opening or "" for side in outline if side.role == "inlet"])
    elif scene.inflow:
        found["inlets"] = {"inletMeanVelocity": "[inflowMeanVelocity]"}
        found["inlets"] |= {"inletFactors": "[inflowFactor]"} if scene.time else {}
        found["inlet_profiles"] = [scene.inflow.expression.to_freefem({"y": "inletS"})]
    if has_openings(scene):
        found["openings"] = _openings(scene, [side for side in outline if side.role == "outlet"])
    return found


def _inlets(scene: Scene, names: list[str]) -> dict[str, Any]:
    if not names:
        return {}
    places = [scene.geometry.named_inlets[name] for name in names]  # type: ignore[union-attr]
    own = scene.geometry.kind == "mesh"
    values = {"inletMeanVelocity": [_variable("inlet", name, "mean_velocity") for name in names]}
    if own:
        numbers = {"X": 0, "Y": 1}
        for axis, i in numbers.items():
            values[f"inletStart{axis}"] = [f"{place.start[i]!r}/unitLength" for place in places]
            values[f"inletInward{axis}"] = [repr(place.inward[i]) for place in places]
        values["inletLength"] = [f"{place.height!r}/unitLength" for place in places]
    if scene.time:
        values["inletFactors"] = [_factor(scene, name) for name in names]
    profiles = [scene.inlet[name].expression.to_freefem({"y": "inletS"}) for name in names]
    return {"inlets": arrays(values), "inlet_profiles": profiles}


def _openings(scene: Scene, sides: list[Boundary]) -> dict[str, str]:
    """Return, of each opening, P, the factor of time on it, R, and what the stabilisation against backflow weighs."""
    values: dict[str, list[str]] = {"openingPressures": [], "openingResistances": []}
    stored = has_reservoirs(scene)
    values |= {"openingCompliances": [], "openingDistalResistances": []} if stored else {}
    factors, weights = [], []
    for side in sides:
        name = side.opening or ""
        inlet = scene.inlet.get(name)
        table: Inlet | Outlet = inlet or scene.outlets.get(name) or scene.outlet  # type: ignore[assignment]
        where = "inlet" if inlet else "outlet"
        values["openingPressures"].append("0." if table.pressure is None else _variable(where, name, "pressure"))
        behind = ("resistance", "proximal_resistance", "distal_resistance")
        given = [_variable(where, name, key) for key in behind if getattr(table, key, None) is not None]
        if stored:
            stores = isinstance(table, Outlet) and table.law.stores
            distal = given.pop() if stores else "1."
            compliance = _variable(where, name, "compliance") if stores else "0."
            given += [f"timeTheta/({compliance}/timeK + timeTheta/{distal})"] if stores else []
            values["openingCompliances"].append(compliance)
            values["openingDistalResistances"].append(distal)
        values["openingResistances"].append(" + ".join(given) or "0.")
        factors.append(_factor(scene, name) if inlet else "Ramp(at)")
        if getattr(table, "backflow", None) is not None:
            weights.append(f"(label == {side.label})*{_variable(where, name, 'backflow')}")
    if scene.time:
        values["openingFactors"] = factors
    found = arrays(values)
    return found | ({"outletBackflow": f"({' + '.join(weights)})"} if weights else {})


def _factor(scene: Scene, name: str) -> str:
    """Return ramp times waveform of an inlet at the time `at`, `t` in s; 1 in a steady scene."""
    inlet = scene.inlet[name]
    if not scene.time:
        return "1."
    text = "1."
    if inlet.fourier is not None:
        angle = f"2*pi*at/{_variable('inlet', name, 'period')}"
        terms = zip(inlet.fourier.cosine, inlet.fourier.sine, strict=True)
        text = " + ".join(f"({a!r})*cos({k}*{angle}) + ({b!r})*sin({k}*{angle})" for k, (a, b) in enumerate(terms))
    elif inlet.waveform is not None:
        text = inlet.waveform_expression.to_freefem()
    if inlet.ramp is None:
        return f"({text})"
    ramp = _variable("inlet", name, "ramp")
    return f"(at < {ramp} ? (1-cos(pi*at/{ramp}))/2 : 1.)*({text})"


def _variable(table: str, name: str, key: str) -> str:
    """Return the script's variable of a key of a table by name, or of the only one without."""
    return f"{table}{camel(name)}{camel(key)}"


def _largest(texts: Sequence[str]) -> str:
    found = texts[0] if texts else "0."
    for text in texts[1:]:
        found = f"max({found}, {text})"
    return found
