"""`verify`: cases with known values on several meshes, beside these values, as CSV, Markdown and in the README."""

from studies.harness import processor, replace_block
from studies.tables import NOTHING, TextTable, number, percent
from studies.verification.benchmarks import CAVITY, FINEST, cavity_table, error_table, short
from studies.verification.command import SECTIONS, main, to_frame
from studies.verification.runs import Measurement, Variant, measure
from studies.verification.sources import COLUMNS, ReferenceSet, reference_sets

__all__ = [
    "CAVITY",
    "COLUMNS",
    "FINEST",
    "NOTHING",
    "SECTIONS",
    "Measurement",
    "ReferenceSet",
    "TextTable",
    "Variant",
    "cavity_table",
    "error_table",
    "main",
    "measure",
    "number",
    "percent",
    "processor",
    "reference_sets",
    "replace_block",
    "short",
    "to_frame",
]
