/* A static curve through knots as cubics, with the port's scales; before the first and after the last knot it is a line. */
#ifndef EIGHTPOST_CELLS_H
#define EIGHTPOST_CELLS_H

#include "number.h"

enum { KNOT_COUNT = 25, CELL_COUNT = KNOT_COUNT + 1, COEFFICIENTS = 4 };

/* Coefficients of the powers of v - o in each cell; o is the knot at its left in single precision, of the first cell that at its right. */
typedef number Cells[CELL_COUNT][COEFFICIENTS];

/* The cells of F_s by a shock's parameters (PARAMETERS numbers), and those of the curve f1 if it has the law Hysteresis. */
void find_cells(const double *parameters, int has_hysteresis, Cells curve, Cells lagged);

#endif
