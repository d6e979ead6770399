/* The vehicle's modes as model.c and rates.c use them: b u, rows of C z, friction at the ports. */
#ifndef EIGHTPOST_MODAL_H
#define EIGHTPOST_MODAL_H

#include <string.h>

#include "component.h"
#include "elementary.h"
#include "fresh.h"
#include "vehicle_data.h"

/* Real parts of all modes, then imaginary parts of the pairs, each padded to a multiple of LANES; the padding is zero and stays
 * so. */
typedef struct {
    double at[STATE_BLOCKS * BLOCK];
} Modal;

/* Upper limit of any state, in any unit. */
static const double LARGEST = 1e150;

/* Memory.state: z, and the corresponding inputs including friction. Outputs are computed when they are read. */
enum { REACHED = STATE_COUNT };

/* b u. B is stored in blocks of rows, column by column, so that a compiler keeps a block's sums in registers and adds in the same
 * order everywhere. Inputs that are zero are skipped. */
static inline void load(const double *u, Modal *w)
{
    for (int b = 0; b < STATE_BLOCKS; b++) {
        double sum[BLOCK] = {0.0};
        for (int c = 0; c < INPUTS; c++) {
            if (u[c] == 0.0) {
                continue;
            }
            for (int r = 0; r < BLOCK; r++) {
                sum[r] += B[b][c][r] * u[c];
            }
        }
        memcpy(w->at + b * BLOCK, sum, sizeof sum);
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

static inline int has_friction(const Parameters *p)
{
    for (int i = 0; i < PORT_COUNT; i++) {
        if (p->friction_force[i] > 0.0) {
            return 1;
        }
    }
    return 0;
}

/* The inputs' increase by friction in state z. */
static inline void add_friction(const Parameters *p, const double *z, double *u)
{
    for (int i = 0; i < PORT_COUNT; i++) {
        const double v = row_times(C[PORT_OUTPUT[i]], z);
        u[PORT_INPUT[i]] += p->friction_force[i] * hyperbolic_tangent(v / p->friction_velocity[i]);
    }
}

/* Limits far below an overflow of an output or of the next step. */
static inline int is_sound(const Modal *z)
{
    double sum[LANES] = {0.0};
    for (int k = 0; k < STATE_COUNT; k += LANES) {
        for (int i = 0; i < LANES; i++) {
            sum[i] += z->at[k + i] * z->at[k + i];
        }
    }
    return (sum[0] + sum[2]) + (sum[1] + sum[3]) < LARGEST * LARGEST;
}

/* Saves state z, and the inputs there. */
static inline void reach(Memory *memory, const Modal *z, int rubs)
{
    double *u = memory->state + REACHED;
    memcpy(memory->state, z->at, STATE_COUNT * sizeof *z->at);
    copy_fresh(u, memory->values.named.signals.input, INPUTS);
    if (rubs) {
        add_friction(&memory->values.named.parameters, z->at, u);
    }
}

#endif
