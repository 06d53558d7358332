"""`verify`: cases with known values on several meshes, beside these values, as CSV, Markdown and in the README."""

from studies.verification.benchmarks import CAVITY, FINEST, cavity_table, error_table, short
from studies.verification.command import SECTIONS, main, to_frame
from studies.verification.outputs import command_line, links, origin, prepare, processor, publish, replace_block
from studies.verification.runs import Measurement, Variant, measure
from studies.verification.sources import COLUMNS, ReferenceSet, reference_sets
from studies.verification.tables import NOTHING, TextTable, number, percent

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
    "command_line",
    "error_table",
    "links",
    "main",
    "measure",
    "number",
    "origin",
    "percent",
    "prepare",
    "processor",
    "publish",
    "reference_sets",
    "replace_block",
    "short",
    "to_frame",
]
