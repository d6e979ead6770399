/* The steady state of constant inputs, with port springs in balance. */
#ifndef EIGHTPOST_STEADY_STATE_H
#define EIGHTPOST_STEADY_STATE_H

#include <string.h>

#include "modal.h"
#include "port_forces.h"

/* Limits of the search: Newton steps, and the last relative change [m]. */
enum { MOST_NEWTON_STEPS = 50 };
static const double AGREEMENT = 1e-13;

/* Equations for the displacements at the springs: a row of SPRINGS + 1 numbers each, the last one being the right side. */
typedef struct {
    double row[SPRINGS][SPRINGS + 1];
} Balance;

/* The steady state z = -b u / lambda, and that of the coupled states; the ports do not move then. */
static void settle(const double *u, Modal *z)
{
    Modal w;
    load(u, &w);
    for (int k = 0; k < PAIR_COUNT; k++) {
        const double square = SIGMA[k] * SIGMA[k] + OMEGA[k] * OMEGA[k], re = w.at[k], im = w.at[MODES + k];
        z->at[k] = -(re * SIGMA[k] + im * OMEGA[k]) / square;
        z->at[MODES + k] = -(im * SIGMA[k] - re * OMEGA[k]) / square;
    }
    for (int k = PAIR_COUNT; k < FIRST_COUPLED; k++) {
        z->at[k] = -w.at[k] / SIGMA[k];
    }
    for (int r = 0; r < COUPLED_COUNT; r++) {
        z->at[FIRST_COUPLED + r] = coupled_row(COUPLED_AT_REST + r * COUPLED, w.at);
    }
}

static inline double magnitude(double x)
{
    return x < 0.0 ? -x : x;
}

static void exchange_rows(Balance *e, int a, int b)
{
    for (int c = 0; c <= SPRING_COUNT; c++) {
        const double kept = e->row[a][c];
        e->row[a][c] = e->row[b][c];
        e->row[b][c] = kept;
    }
}

/* Gaussian elimination with row exchange; 0 if there is no unique solution. */
static int solve_balance(Balance *e, double *x)
{
    for (int k = 0; k < SPRING_COUNT; k++) {
        int pivot = k;
        for (int r = k + 1; r < SPRING_COUNT; r++) {
            pivot = magnitude(e->row[r][k]) > magnitude(e->row[pivot][k]) ? r : pivot;
        }
        if (!(magnitude(e->row[pivot][k]) > 0.0)) {
            return 0;
        }
        exchange_rows(e, k, pivot);
        for (int r = k + 1; r < SPRING_COUNT; r++) {
            const double share = e->row[r][k] / e->row[k][k];
            for (int c = k; c <= SPRING_COUNT; c++) {
                e->row[r][c] -= share * e->row[k][c];
            }
        }
    }
    for (int k = SPRING_COUNT - 1; k >= 0; k--) {
        x[k] = e->row[k][SPRING_COUNT];
        for (int c = k + 1; c < SPRING_COUNT; c++) {
            x[k] -= e->row[k][c] * x[c];
        }
        x[k] /= e->row[k][k];
    }
    return 1;
}

/* Displacements at the springs in the steady state of inputs u. */
static void displacements_at_rest(const double *u, double *d)
{
    Modal z;
    memset(&z, 0, sizeof z);
    settle(u, &z);
    for (int s = 0; s < SPRING_COUNT; s++) {
        d[s] = row_times(C[SPRING_OUTPUT[s]], z.at);
    }
}

/* One Newton step for d = d0 + G k2 d^2; 0 if it is not possible, 1 if it is the last one, otherwise 2. */
static int newton_step(const double *k2, double (*G)[SPRINGS], const double *d0, double *d)
{
    Balance e;
    double change[SPRINGS];
    int is_last = 1;
    for (int r = 0; r < SPRING_COUNT; r++) {
        e.row[r][SPRING_COUNT] = d0[r] - d[r];
        for (int c = 0; c < SPRING_COUNT; c++) {
            e.row[r][c] = (r == c ? 1.0 : 0.0) - 2.0 * G[c][r] * (k2[c] * d[c]);
            e.row[r][SPRING_COUNT] += G[c][r] * (k2[c] * (d[c] * d[c]));
        }
    }
    if (!solve_balance(&e, change)) {
        return 0;
    }
    for (int s = 0; s < SPRING_COUNT; s++) {
        d[s] += change[s];
        is_last &= magnitude(change[s]) <= AGREEMENT * (magnitude(d[s]) + 1.0);
    }
    return is_last ? 1 : 2;
}

/* Adds the forces of the port springs in the steady state to the inputs; 0 if none is found. */
static int balance_springs(const Parameters *p, double *u, Message *why)
{
    double G[SPRINGS][SPRINGS], d0[SPRINGS], d[SPRINGS] = {0.0};
    int found = 2;
    displacements_at_rest(u, d0);
    for (int s = 0; s < SPRING_COUNT; s++) {
        double unit[INPUTS] = {0.0};
        unit[PORT_INPUT[SPRING_PORT[s]]] = 1.0;
        displacements_at_rest(unit, G[s]);
    }
    for (int k = 0; k < MOST_NEWTON_STEPS && found == 2; k++) {
        found = newton_step(p->port_spring, G, d0, d);
    }
    if (found != 1) {
        say(why, "the port springs have no steady state at these inputs, or the search for it does not converge: check "
                 "port_spring and the inputs, or set start_at_equilibrium to false");
        return 0;
    }
    for (int s = 0; s < SPRING_COUNT; s++) {
        u[PORT_INPUT[SPRING_PORT[s]]] += p->port_spring[s] * (d[s] * d[s]);
    }
    return 1;
}

static inline int has_springs(const Parameters *p)
{
    int any = 0;
    for (int s = 0; s < SPRING_COUNT; s++) {
        any |= p->port_spring[s] != 0.0;
    }
    return any;
}

/* The steady state of the inputs; 0 if the port springs have none. */
static int rest(const Parameters *p, const double *inputs, Modal *z, Message *why)
{
    double u[INPUTS];
    memcpy(u, inputs, sizeof u);
    if (has_springs(p) && !balance_springs(p, u, why)) {
        return 0;
    }
    settle(u, z);
    return 1;
}

#endif
