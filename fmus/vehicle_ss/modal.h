/* The vehicle's modes as model.c and rates.c use them: b u, rows of C z. */
#ifndef EIGHTPOST_MODAL_H
#define EIGHTPOST_MODAL_H

#include <string.h>

#include "component.h"
#include "real.h"
#include "vehicle_data.h"

/* Real parts of all modes, then imaginary parts of the pairs, each padded to a multiple of LANES; the padding is zero and stays
 * so. */
typedef struct {
    real at[STATE_BLOCKS * BLOCK];
} Modal;

/* The last of the real states that are coupled with each other, if modes are nearly dependent; SIGMA and OMEGA are zero there. */
enum { FIRST_COUPLED = MODE_COUNT - COUPLED_COUNT };

/* Memory.state: z, the corresponding inputs including the forces of the ports, and the deflections of the bristles. Outputs are
 * computed when they are read. */
enum { REACHED = STATE_COUNT, BENT = STATE_COUNT + INPUTS };

/* Upper limit of any state and input, in any unit: far below an overflow of an output, a derivative or the next step. */
static const double LARGEST = 1e150;

/* The factors of one step. */
typedef struct {
    double h;
    double e_re[MODES], e_im[MODES]; /* e^(lambda h) */
    double first_re[MODES], first_im[MODES]; /* h (phi1 - phi2) */
    double second_re[MODES], second_im[MODES]; /* h phi2 */
    double coupled_e[COUPLED_CELLS], coupled_first[COUPLED_CELLS], coupled_second[COUPLED_CELLS]; /* by rows */
    double product[COUPLED_CELLS];
} Factors;

/* A row of a matrix of the coupled states times these. */
static inline real coupled_row(const double *row, const real *z)
{
    real sum = uniform(0.0);
    for (int c = 0; c < COUPLED_COUNT; c++) {
        sum += row[c] * z[FIRST_COUPLED + c];
    }
    return sum;
}

/* b u. B is stored in blocks of rows, column by column, so that a compiler keeps a block's sums in registers and adds in the same
 * order everywhere. Inputs that are zero are skipped. */
static inline void load(const double *u, Modal *w)
{
    int moving[INPUTS], count = 0;
    for (int c = 0; c < INPUTS; c++) {
        moving[count] = c;
        count += u[c] != 0.0;
    }
    for (int b = 0; b < STATE_BLOCKS; b++) {
        double sum[BLOCK] = {0.0};
        for (int k = 0; k < count; k++) {
            const double input = u[moving[k]], *column = B[b][moving[k]];
            for (int r = 0; r < BLOCK; r++) {
                sum[r] += column[r] * input;
            }
        }
        memcpy(&w->at[b * BLOCK], sum, sizeof sum);
    }
}

/* One row of C times z, as four sums. */
static inline double row_times(const double *row, const double *z)
{
    double sum[LANES] = {0.0};
    for (int k = 0; k < STATE_COUNT; k += LANES) {
        for (int i = 0; i < LANES; i++) {
            sum[i] += row[k + i] * z[k + i];
        }
    }
    return (sum[0] + sum[2]) + (sum[1] + sum[3]);
}

#endif
