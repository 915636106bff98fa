"""HDF5 results: written safely, read back checked, compared as numbers."""

from ancf2d.results.reader import Results, Table, open_results
from ancf2d.results.records import BodyRecord, Column, Units
from ancf2d.results.target import part_path
from ancf2d.results.writer import ResultWriter

__all__ = [
    "BodyRecord",
    "Column",
    "ResultWriter",
    "Results",
    "Table",
    "Units",
    "open_results",
    "part_path",
]
