/* The cells of a curve, from the files of the FMUs. */
#include "cells.h"

#include <string.h>

#include "component.h"

enum { CONTINUOUS_STATES = 2 };
#define SEVERAL_STATES
#define law_start start_of_one /* those of lanes have the law's own names */
#define law_advance advance_one
#define time_constant time_constants
#include "hysteresis.c.inc"

static void find_line(const Parameters *p, double *cell, double knot, double slope, double lagged_slope)
{
    cell[LEFT] = knot;
    cell[FORCE] = valve_force(p, knot);
    cell[SLOPE] = scale(p, knot) * slope;
    cell[LAGGED] = scale(p, knot) * lagged_curve(p, knot);
    cell[LAGGED_SLOPE] = scale(p, knot) * lagged_slope;
}

static void find_cell(const Parameters *p, double *cell, double left, double right, double lagged_bend)
{
    const double middle = 0.5 * (left + right), factor = scale(p, middle); /* the same in the whole cell */
    const Cell c = cell_at(p, middle);
    cell[LEFT] = left;
    cell[FORCE] = factor * c.force;
    cell[SLOPE] = factor * c.start / c.width;
    cell[BEND] = factor * bend_of(&c) / (c.width * c.width);
    cell[TWIST] = factor * twist_of(&c) / (c.width * c.width * c.width);
    cell[LAGGED] = factor * lagged_curve(p, left);
    cell[LAGGED_BEND] = factor * lagged_bend;
}

void find_cells(const double *parameters, int has_hysteresis, Cells cells)
{
    Parameters p;
    memset(cells, 0, sizeof(Cells));
    memset(&p, 0, sizeof p);
    memcpy(&p, parameters, PARAMETERS * sizeof *parameters);
    if (!has_knots(&p)) {
        return;
    }
    const double *knots = p.curve_knot_velocity, *c = p.curve_lagged_slope;
    if (!has_hysteresis) {
        memset(p.curve_lagged_slope, 0, sizeof p.curve_lagged_slope);
    }
    find_line(&p, cells[0], knots[0], p.curve_rebound_slope, c[0]);
    find_line(&p, cells[KNOTS], knots[KNOTS - 1], p.curve_compression_slope, c[KNOTS - 1]);
    for (int k = 0; k < KNOTS - 1; k++) {
        const double width = knots[k + 1] - knots[k];
        find_cell(&p, cells[k + 1], knots[k], knots[k + 1], 0.5 * (c[k + 1] - c[k]) / width);
        cells[k + 1][LAGGED_SLOPE] = scale(&p, 0.5 * (knots[k] + knots[k + 1])) * c[k];
    }
}
