/* A static curve through knots as cubics in v - left, with the port's scales; before the first and after the last knot it is a line. */
#ifndef EIGHTPOST_CELLS_H
#define EIGHTPOST_CELLS_H

enum { KNOT_COUNT = 25, CELLS = KNOT_COUNT + 1 };

/* Coefficients of a cell: F_s, and the curve f1 of Hysteresis. */
enum { LEFT, FORCE, SLOPE, BEND, TWIST, LAGGED, LAGGED_SLOPE, LAGGED_BEND, COEFFICIENTS };

typedef double Cells[CELLS][COEFFICIENTS];

/* The cells of a shock's parameters (PARAMETERS numbers), and of f1 if it has the law Hysteresis. */
void find_cells(const double *parameters, int has_hysteresis, Cells cells);

#endif
