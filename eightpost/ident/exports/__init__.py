"""Export of models, frequency responses and shock curves to other tools."""

from eightpost.ident.exports.matlab import write_response_mat, write_vehicle_mat
from eightpost.ident.exports.python_control import to_frd
from eightpost.ident.exports.shock_formats import write_shock_table
from eightpost.ident.exports.shock_table import ShockTable, shock_table
from eightpost.ident.exports.universal_file import write_response_uff

__all__ = [
    "ShockTable",
    "shock_table",
    "to_frd",
    "write_response_mat",
    "write_response_uff",
    "write_shock_table",
    "write_vehicle_mat",
]
