/* The coupled start: shock forces consistent with the vehicle's state under them, found by Newton's method. */
#include <string.h>

#include "machine.h"
#include "part_kinds.h"

/* Relative accuracy of the forces of a coupled start. With springs alone two steps suffice: a Newton step, and one for rounding. */
static const double AGREEMENT = 1e-13;
enum { MOST_NEWTON_STEPS = 20 };

/* Starts every part, the vehicle with the forces `taken`; `missed` is the shocks' forces minus these. */
static int start_all(Machine *m, const double *outside, const double *taken, double *missed, Message *why)
{
    double from[MOST_INPUTS];
    memcpy(m->now, taken, FORCES * sizeof *taken);
    for (int p = 0; p < PARTS; p++) {
        Message message = {.length = 0};
        feed(m, p, outside, outside, 1.0, from, m->values[p]);
        memcpy(m->values[p], from, (size_t)PART[p].input_count * sizeof *from);
        if (!start(PART[p].kind, m->part[p], &message)) {
            add_part_message(p, &message, why);
            return 0;
        }
        read_part(m, p);
        for (int s = FORCES; s < COUPLED && p == 0; s++) {
            m->now[s] = m->ahead[s];
        }
    }
    for (int s = 0; s < FORCES; s++) {
        missed[s] = m->ahead[s] - taken[s];
    }
    return 1;
}

static int agrees(const double *taken, const double *missed)
{
    for (int s = 0; s < FORCES; s++) {
        if (!(size_of(missed[s]) <= AGREEMENT * (size_of(taken[s]) + 1.0))) {
            return 0;
        }
    }
    return 1;
}

/* A system of linear equations: a row of FORCES + 1 numbers for each force, the last one being the right side. */
typedef struct {
    double row[FORCES][FORCES + 1];
} Equations;

/* Gaussian elimination with row exchange; 0 if there is no unique solution. */
static int solved(Equations *e, double *x)
{
    for (int k = 0; k < FORCES; k++) {
        int pivot = k;
        for (int r = k + 1; r < FORCES; r++) {
            pivot = size_of(e->row[r][k]) > size_of(e->row[pivot][k]) ? r : pivot;
        }
        if (!(size_of(e->row[pivot][k]) > 1e-12)) {
            return 0;
        }
        for (int c = 0; c <= FORCES; c++) {
            const double exchanged = e->row[k][c];
            e->row[k][c] = e->row[pivot][c];
            e->row[pivot][c] = exchanged;
        }
        for (int r = k + 1; r < FORCES; r++) {
            const double share = e->row[r][k] / e->row[k][k];
            for (int c = k; c <= FORCES; c++) {
                e->row[r][c] -= share * e->row[k][c];
            }
        }
    }
    for (int k = FORCES - 1; k >= 0; k--) {
        x[k] = e->row[k][FORCES];
        for (int c = k + 1; c < FORCES; c++) {
            x[k] -= e->row[k][c] * x[c];
        }
        x[k] /= e->row[k][k];
    }
    return 1;
}

/* One Newton step; derivatives are differences, which are exact for linear gas springs. */
static int improve(Machine *m, const double *outside, double *taken, const double *missed, Message *why)
{
    Equations e;
    double other[FORCES], then[FORCES];
    for (int c = 0; c < FORCES; c++) {
        memcpy(other, taken, sizeof other);
        other[c] += 1e-3 * size_of(taken[c]) + 1.0;
        if (!start_all(m, outside, other, then, why)) {
            return 0;
        }
        for (int r = 0; r < FORCES; r++) {
            e.row[r][c] = (missed[r] - then[r]) / (other[c] - taken[c]);
        }
    }
    for (int r = 0; r < FORCES; r++) {
        e.row[r][FORCES] = missed[r];
    }
    if (!solved(&e, other)) {
        say(why, "the vehicle and the springs of its shocks have no unique equilibrium: set start_at_equilibrium to false");
        return 0;
    }
    for (int s = 0; s < FORCES; s++) {
        taken[s] += other[s];
    }
    return 1;
}

int settle(Machine *m, const double *outside, Message *why)
{
    double taken[FORCES] = {0.0}, missed[FORCES];
    for (int k = 0; k < MOST_NEWTON_STEPS; k++) {
        if (!start_all(m, outside, taken, missed, why)) {
            return 0;
        }
        if (agrees(taken, missed)) {
            return 1;
        }
        if (!improve(m, outside, taken, missed, why)) {
            return 0;
        }
    }
    say(why, "the coupled start of vehicle and shocks did not converge: check inputs, gas_stiffness and gas_preload");
    return 0;
}
