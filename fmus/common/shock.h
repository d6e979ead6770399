/* Functions that a shock law defines for the port of docs/reference/ports.md (common/shock.c), like ShockLaw in eightpost/shock/law.py. */
#ifndef EIGHTPOST_SHOCK_H
#define EIGHTPOST_SHOCK_H

#include "component.h"
#include "real.h"

/* Factors of a step h and a tau: 1 - e and 1 - (1 - e) tau / h. They are kept, because most steps have the same length. */
typedef struct {
    double step, time_constant, rise, ramp;
} LagFactors;

/* A piece of time in which the damper velocity [m/s] and F_s [N] change linearly. */
typedef struct {
    real velocity_start, static_start;
    real velocity_end, static_end;
    real step; /* [s] */
} Piece;

/* alpha [1], the share of the lagged force, at a static force [N]. */
double law_lag_weight(const Parameters *p, double static_force);
/* d alpha / d F_s [1/N]. */
double law_lag_weight_slope(const Parameters *p, double static_force);
/* The reason why the law's own parameters contradict each other, or NULL. */
const char *law_refuses(const Parameters *p);

/* ---- A law with one state, F_lag ------------------------------------------------------------------------------------- */

/* dF_lag/dt [N/s], and its partial derivatives by F_lag and by F_s [1/s]. */
typedef struct {
    double value, by_lagged, by_static;
} Rate;

/* F_lag [N] after a piece. */
double law_advance_lag(const Parameters *p, LagFactors *kept, double lagged, const Piece *piece);
/* dF_lag/dt at F_lag and F_s [N]: the equation that law_advance_lag solves. */
Rate law_rate(const Parameters *p, double lagged, double static_force);

/* ---- A law with several states, which are continuous states of interface.toml ------------------------------------------ */

enum { STATE_COUNT = CONTINUOUS_STATES > 1 ? CONTINUOUS_STATES : 1 };

typedef struct {
    real at[STATE_COUNT];
} State;

/* Derivatives of the valve force F_v and of the rate of each state, which does not depend on the other states. */
typedef struct {
    double force_by_velocity, force_by_state[STATE_COUNT];
    double rate[STATE_COUNT], rate_by_velocity[STATE_COUNT], rate_by_state[STATE_COUNT];
} Slopes;

#ifdef SEVERAL_STATES
/* The states of steady motion at a damper velocity [m/s] and its F_s [N]. */
State law_start(const Parameters *p, real velocity, real static_force);
/* The variable that is state k. */
double *law_state(Signals *s, int k);
/* The states after a piece; STATE_COUNT factors are kept. */
void law_advance(const Parameters *p, LagFactors *kept, State *state, const Piece *piece);
/* F_v [N] at a damper velocity [m/s] and its F_s [N]. */
real law_force(const Parameters *p, const State *state, real velocity, real static_force);
Slopes law_slopes(const Parameters *p, const State *state, double velocity, double static_force);
#endif

#endif
