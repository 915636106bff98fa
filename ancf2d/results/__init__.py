"""HDF5 results: safe writing, checked reading, numerical comparison."""

from ancf2d.results.checkpoint import Checkpoint, read_checkpoint
from ancf2d.results.compare import (
    Difference,
    compare_results,
    comparison_text,
    differences_json,
    left_out,
)
from ancf2d.results.info import describe, describe_text
from ancf2d.results.reader import Results, open_results
from ancf2d.results.records import BodyRecord, Column, FieldRecord, Units
from ancf2d.results.series import Table
from ancf2d.results.target import check_output, part_path
from ancf2d.results.writer import ResultWriter, write_tables

__all__ = [
    "BodyRecord",
    "Checkpoint",
    "Column",
    "Difference",
    "FieldRecord",
    "ResultWriter",
    "Results",
    "Table",
    "Units",
    "check_output",
    "compare_results",
    "comparison_text",
    "describe",
    "describe_text",
    "differences_json",
    "left_out",
    "open_results",
    "part_path",
    "read_checkpoint",
    "write_tables",
]
