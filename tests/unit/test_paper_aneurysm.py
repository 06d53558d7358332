"""The study of the aneurysm: its scenes, pictures and text, without FreeFEM."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pytest
from run_folders import given_state, structured_mesh

from ffsi.report import walls
from ffsi.result import pictures
from ffsi.result.fields import Fields
from ffsi.scene.fluids import Carreau, Newtonian
from studies.paper import aneurysm


def test_eight_variants_and_their_systole() -> None:
    scenes = {variant.name: variant.scene(1) for variant in aneurysm.VARIANTS}
    assert list(scenes) == [
        "steady-elastic", "steady-elastic-carreau", "steady-rigid", "steady-rigid-carreau", "pulsatile-elastic",
        "pulsatile-elastic-carreau", "pulsatile-rigid", "pulsatile-rigid-carreau",
    ]  # fmt: skip
    for name, scene in scenes.items():
        assert scene.mesh.level == 1 and scene.physics == ("fsi" if "elastic" in name else "fluid")
        assert isinstance(scene.fluid, Carreau if "carreau" in name else Newtonian)
        assert (scene.time is not None) == (scene.output.wall is not None) == name.startswith("pulsatile")
        assert (scene.support is not None) == name.startswith("pulsatile-elastic")
        if scene.time:
            assert scene.inflow and scene.inflow.period
            assert scene.time.output_interval == pytest.approx(scene.inflow.period / 20)
    with pytest.raises(Exception, match=r"mesh\.level = 7"):
        aneurysm.VARIANTS[0].scene(7)
    found = aneurysm.systole(SimpleNamespace(scene=aneurysm.VARIANTS[4].scene(1)))  # type: ignore[arg-type]
    period = 60 / 84
    assert 3 * period < found < 4 * period and found / period % 1 == pytest.approx(0.648, abs=1e-3)


@pytest.fixture
def fields() -> Fields:
    mesh = structured_mesh()
    return Fields.from_raw(mesh, given_state(mesh))


def shades(figure: Any) -> int:
    from io import BytesIO

    from PIL import Image

    image = np.asarray(Image.open(BytesIO(pictures.to_png(figure, dpi=50))).convert("RGB"))
    return len(np.unique(image.reshape(-1, 3), axis=0))


def wall(cycle: int | None = None) -> pd.DataFrame:
    arc = np.linspace(0, 0.01, 21)
    part = np.where(np.abs(arc - 0.005) < 0.001, "dome", np.where(np.abs(arc - 0.005) < 0.002, "neck", "vessel"))
    table = pd.DataFrame({"line": "dome", "arc": arc, "part": part, "wss": 1 + arc, "pressure": 5.0 - 100 * arc})
    return table if cycle is None else table.assign(cycle=cycle, tawss=1 + arc, osi=0.1, rrt=2.0)


def test_pictures_and_curves_of_mesh_stress_dome_and_neck(fields: Fields) -> None:
    assert shades(aneurysm.mesh_picture(fields, "title")) > 20
    stress = np.linspace(0, 1, len(fields.points))
    assert shades(walls.wall_stress(fields, stress, 1.0, "title")) > 20
    low, high = fields.deformed.min(axis=0), fields.deformed.max(axis=0)
    assert shades(aneurysm.velocity_within(fields, (low, (low + high) / 2))) > 20
    figure = walls.along_walls(
        {"a": wall(), "b": wall()}, [("wss", "WSS (Pa)"), ("pressure", "p (Pa)")], "title", ("wss",)
    )
    first, second = figure.axes
    assert first.get_yscale() == "log" and second.get_yscale() == "linear" and len(first.get_lines()) == 2
    shaded = sorted(tuple(np.round(patch.get_extents().transformed(first.transData.inverted()).intervalx, 2))
                    for patch in first.patches)  # fmt: skip
    assert shaded == [(3.5, 4.0), (4.5, 5.5), (6.0, 6.5)]


def result(pulsatile: bool, failure: str = "") -> Any:
    quantities = {
        "wss_mean_neck": 0.2, "wss_mean_dome": 0.01, "dome_inflow": 1e-6, "flow_rate_in": 1e-5, "pressure_drop": 3.0,
        "mass_balance": 1e-16,
    }  # fmt: skip
    parts = {f"{name}_{part}": 0.5 for part in ("dome", "neck", "vessel") for name in ("tawss_mean", "osi_mean")}
    data = {
        "unknowns": 900, "check": {"momentum": 2e-11, "drag_difference": None}, "timings": {"script": 12.34},
        "freefem": {"version": "4.9", "solver": "MUMPS"}, "time": {"steps": 400} if pulsatile else None,
        "cycles": [parts, parts | {"tawss_change": 3e-5}] if pulsatile else None,
    }  # fmt: skip
    return SimpleNamespace(
        data=data, quantities=quantities, failure=failure, solved=failure != "not-converged",
        status="failed" if failure else "converged", wall=wall(2 if pulsatile else None),
    )  # fmt: skip


def test_text() -> None:
    results = {variant: result(variant.pulsatile) for variant in aneurysm.VARIANTS}
    text = aneurysm.text_of(results, ["figure-15-mesh.png"])
    assert "Written by `python -m studies paper --aneurysm` (FreeFEM 4.9 with MUMPS)." in text
    assert text.count("](figure-15-mesh.png)") == 1 and "figure-16" not in text
    assert "| pulsatile | rigid, Carreau | 900 | 400 | 12.3 | 2e-11 | converged |" in text
    assert "| elastic, Newtonian | dome | 0.5 |" in text and "3e-05" in text
    assert "20 times that of the dome; 10 % of the flow enters the dome" in text
    assert "4.45 to 4.55 Pa" in text  # pressure in the dome


def test_every_variant_is_run_and_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    ran: dict[str, Any] = {}
    monkeypatch.setattr(
        aneurysm, "run_all", lambda scenes, runs: ran.update({runs / name: scenes[name] for name in scenes})
    )
    monkeypatch.setattr(
        aneurysm, "load_result", lambda path: result(bool(ran[path].time), "not-converged" if ran[path].time else "")
    )
    monkeypatch.setattr(aneurysm, "draw", lambda results: {})
    out = tmp_path / "out"
    assert aneurysm.main(level=1, out=out, runs=tmp_path / "runs") == ["", "", "", "", *["not-converged"] * 4]
    assert list(ran) == [tmp_path / "runs/aneurysm-level-1" / variant.name for variant in aneurysm.VARIANTS]
    assert sorted(path.name for path in out.iterdir()) == [
        *(f"aneurysm-steady-{name}-wall.csv" for name in ("elastic-carreau", "elastic", "rigid-carreau", "rigid")),
        "aneurysm.md",
    ]
