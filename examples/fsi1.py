"""A case of the catalogue by its name: Turek and Hron's FSI1, beside the published drag."""

import ffsi

result = ffsi.solve(ffsi.load_scene("turek-fsi1", ["mesh.level=1"]))  # ffsi.solve("turek-fsi1"): on its own mesh
print(result)

PUBLISHED = 14.29426  # N/m: Turek and others, 2010
assert abs(result.quantities["drag"] / PUBLISHED - 1) < 1e-3
assert result.checked  # by the second implementation, which shares no code with the first
