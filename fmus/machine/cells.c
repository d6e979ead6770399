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

/* Moves the origin of a cubic to zero and scales it. */
static void finish_cell(number *cell, double from, double factor)
{
    const double x = -from, c0 = cell[0], c1 = cell[1], c2 = cell[2], c3 = cell[3];
    cell[0] = factor * (c0 + x * (c1 + x * (c2 + x * c3)));
    cell[1] = factor * (c1 + x * (2.0 * c2 + x * 3.0 * c3));
    cell[2] = factor * (c2 + 3.0 * x * c3);
    cell[3] = factor * c3;
}

static void find_line(const Parameters *p, int k, double slope, number *curve, number *lagged)
{
    const double knot = p->curve_knot_velocity[k];
    curve[0] = p->curve_knot_force[k];
    curve[1] = slope;
    lagged[0] = lagged_curve(p, knot);
    lagged[1] = p->curve_lagged_slope[k];
    finish_cell(curve, knot, scale(p, knot));
    finish_cell(lagged, knot, scale(p, knot));
}

static void find_cubic_of(const Parameters *p, int k, number *curve, number *lagged)
{
    const double left = p->curve_knot_velocity[k], middle = 0.5 * (left + p->curve_knot_velocity[k + 1]);
    const double *c = p->curve_lagged_slope, factor = scale(p, middle); /* the same in the whole cell */
    const Cell cell = cell_at(p, middle);
    curve[0] = cell.force;
    curve[1] = cell.start / cell.width;
    curve[2] = bend_of(&cell) / (cell.width * cell.width);
    curve[3] = twist_of(&cell) / (cell.width * cell.width * cell.width);
    lagged[0] = lagged_curve(p, left);
    lagged[1] = c[k];
    lagged[2] = 0.5 * (c[k + 1] - c[k]) / cell.width;
    finish_cell(curve, left, factor);
    finish_cell(lagged, left, factor);
}

void find_cells(const double *parameters, int has_hysteresis, Cells curve, Cells lagged)
{
    Parameters p;
    memset(curve, 0, sizeof(Cells));
    memset(lagged, 0, sizeof(Cells));
    memset(&p, 0, sizeof p);
    memcpy(&p, parameters, PARAMETERS * sizeof *parameters);
    if (!has_knots(&p)) {
        return;
    }
    if (!has_hysteresis) {
        memset(p.curve_lagged_slope, 0, sizeof p.curve_lagged_slope);
    }
    find_line(&p, 0, p.curve_rebound_slope, curve[0], lagged[0]);
    for (int k = 0; k < KNOTS - 1; k++) {
        find_cubic_of(&p, k, curve[k + 1], lagged[k + 1]);
    }
    find_line(&p, KNOTS - 1, p.curve_compression_slope, curve[KNOTS], lagged[KNOTS]);
}
