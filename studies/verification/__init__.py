"""`verify`: cases with known values on several meshes, beside these values, as CSV, Markdown and in docs/results.md."""
