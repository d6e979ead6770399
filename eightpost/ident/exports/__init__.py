"""Export of models and frequency responses to other tools, and import of such files."""

from eightpost.ident.exports.matlab import read_response_mat, read_vehicle_mat, write_response_mat, write_vehicle_mat
from eightpost.ident.exports.python_control import from_frd, to_frd
from eightpost.ident.exports.universal_file import read_response_uff, write_response_uff

__all__ = [
    "from_frd",
    "read_response_mat",
    "read_response_uff",
    "read_vehicle_mat",
    "to_frd",
    "write_response_mat",
    "write_response_uff",
    "write_vehicle_mat",
]
