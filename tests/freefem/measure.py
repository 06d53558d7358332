"""Measure the two tables of test_cases.py again and write them there: `python tests/freefem/measure.py`.

After a deliberate change of mesh or discretisation only; look at the difference before committing it.
"""

import re
from pathlib import Path

from conftest import scene_of

from ffsi.result.published import references_for
from ffsi.run.one_scene import solve
from ffsi.scene import CASES

STEADY = {name: scene for name, scene in CASES.items() if scene.time is None}

QUANTITIES = ("drag", "lift", "drag_surface", "lift_surface", "pressure_drop", "pressure_difference")
QUANTITIES += ("tip_ux", "tip_uy", "min_jacobian")


def level_0(case: str) -> list[str]:
    found = solve(scene_of(case)).quantities
    rows = [f'        "{name}": {found[name]:.10g},' for name in QUANTITIES if name in found]
    return [f'    "{case}": {{', *rows, "    },"]


def level_1(case: str) -> list[str]:
    result, rows = solve(scene_of(case, "mesh.level=1")), []
    for name, reference in references_for(result.scene).items():
        if name in result.quantities:
            error = abs(reference.relative_error(result.quantities[name]))
            rows.append(f'    ("{case}", "{name}"): {max(1.5 * error, 1e-5):.1e},  # {error:.2e}')
    return rows


def replace(text: str, name: str, rows: list[str]) -> str:
    pattern = re.compile(name + r" = {\n.*?^}\n", re.DOTALL | re.MULTILINE)
    return pattern.sub(lambda _: "\n".join([f"{name} = {{", *rows, "}", ""]), text)


if __name__ == "__main__":
    path = Path(__file__).with_name("test_cases.py")
    text = replace(path.read_text(), "LEVEL_0", [row for case in STEADY for row in level_0(case)])
    path.write_text(replace(text, "LEVEL_1", [row for case in STEADY for row in level_1(case)]))
