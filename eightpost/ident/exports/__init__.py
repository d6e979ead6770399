"""Export of models, frequency responses and shock curves to other tools."""

from eightpost.ident.exports.model_formats import to_frd, write_response_mat, write_response_uff, write_vehicle_mat
from eightpost.ident.exports.shock_formats import write_shock_table
from eightpost.ident.exports.shock_table import ShockTable, shock_table

__all__ = [
    "ShockTable",
    "shock_table",
    "to_frd",
    "write_response_mat",
    "write_response_uff",
    "write_shock_table",
    "write_vehicle_mat",
]
