/* A step of the modes, and a sub-step with friction and springs at the ports. */
#ifndef EIGHTPOST_ADVANCE_H
#define EIGHTPOST_ADVANCE_H

#include <string.h>

#include "modal.h"
#include "port_forces.h"

/* z(h) from z, b u0 and b u1. */
static inline void advance(const Factors *restrict f, const real *restrict z, const Modal *restrict w0,
                           const Modal *restrict w1, Modal *restrict end)
{
    const real *x = z, *y = z + MODES, *a = w0->at, *b = w0->at + MODES, *c = w1->at, *d = w1->at + MODES;
    for (int k = 0; k < PAIRS; k++) {
        end->at[k] = (f->e_re[k] * x[k] - f->e_im[k] * y[k]) + (f->first_re[k] * a[k] - f->first_im[k] * b[k]) +
                     (f->second_re[k] * c[k] - f->second_im[k] * d[k]);
        end->at[MODES + k] = (f->e_re[k] * y[k] + f->e_im[k] * x[k]) +
                             (f->first_re[k] * b[k] + f->first_im[k] * a[k]) +
                             (f->second_re[k] * d[k] + f->second_im[k] * c[k]);
    }
    for (int k = PAIRS; k < MODES; k++) {
        end->at[k] = f->e_re[k] * x[k] + f->first_re[k] * a[k] + f->second_re[k] * c[k];
    }
    for (int r = 0; r < COUPLED_COUNT; r++) {
        end->at[FIRST_COUPLED + r] = coupled_row(f->coupled_e + r * COUPLED, x) +
                                     coupled_row(f->coupled_first + r * COUPLED, a) +
                                     coupled_row(f->coupled_second + r * COUPLED, c);
    }
}

static inline void interpolate(const real *from, const real *to, double share, real *u)
{
    for (int i = 0; i < INPUTS; i++) {
        u[i] = from[i] + (to[i] - from[i]) * share;
    }
}

/* A state of the vehicle and of its bristles. */
typedef struct {
    Modal z;
    real bend[PORTS];
} Whole;

/* One sub-step with friction; u0 and u1 are the inputs at its ends. */
static inline void rub(const Parameters *p, const Factors *f, const real *u0, const real *u1, Whole *now)
{
    real start[INPUTS], end[INPUTS], force[PORTS], v0[PORTS], v1[PORTS], bent[PORTS] = {ZERO};
    const int sticks = has_bristles(p);
    Modal w0, w1, predicted, corrected;
    memcpy(start, u0, sizeof start);
    memcpy(end, u1, sizeof end);
    port_velocities(now->z.at, v0);
    port_forces(p, now->z.at, v0, now->bend, force);
    add_to_inputs(force, start);
    add_to_inputs(force, end);
    load(start, &w0);
    load(end, &w1);
    advance(f, now->z.at, &w0, &w1, &predicted);
    port_velocities(predicted.at, v1);
    if (sticks) {
        bend_bristles(p, now->bend, v0, v1, f->h, bent);
    }
    memcpy(end, u1, sizeof end);
    port_forces(p, predicted.at, v1, bent, force);
    add_to_inputs(force, end);
    load(end, &w1);
    advance(f, now->z.at, &w0, &w1, &corrected);
    if (sticks) {
        port_velocities(corrected.at, v1);
        bend_bristles(p, now->bend, v0, v1, f->h, bent);
        memcpy(now->bend, bent, sizeof bent);
    }
    now->z = corrected;
}

#endif
