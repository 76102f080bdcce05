"""The origin of a result: the code, the cell and the files that it depends on, and stores keyed by these."""

from crosspih_common.provenance.code import SourceWatch, code_version, folder_version, hash_sources, part_version
from crosspih_common.provenance.measured import MEASURED_VARIABLE, Measured, measured_in, record_measured
from crosspih_common.provenance.named_files import cell_identity, with_file_contents
from crosspih_common.provenance.store import ResultStore, result_key

__all__ = [
    "MEASURED_VARIABLE",
    "Measured",
    "ResultStore",
    "SourceWatch",
    "cell_identity",
    "code_version",
    "folder_version",
    "hash_sources",
    "measured_in",
    "part_version",
    "record_measured",
    "result_key",
    "with_file_contents",
]
