/* Functions that a shock law defines for the port of docs/ports.md (common/shock.c), like ShockLaw in eightpost/shock/law.py. */
#ifndef EIGHTPOST_SHOCK_H
#define EIGHTPOST_SHOCK_H

#include "component.h"

/* Factors of a step h and a tau: 1 - e and 1 - (1 - e) tau / h. They are kept, because most steps have the same length. */
typedef struct {
    double step, time_constant, rise, ramp;
} LagFactors;

/* A piece of time in which the damper velocity [m/s] and F_s [N] change linearly. */
typedef struct {
    double velocity_start, static_start;
    double velocity_end, static_end;
    double step; /* [s] */
} Piece;

/* alpha [1], the share of the lagged force, at a static force [N]. */
double law_lag_weight(const Parameters *p, double static_force);
/* d alpha / d F_s [1/N]. */
double law_lag_weight_slope(const Parameters *p, double static_force);
/* dF_lag/dt [N/s], and its partial derivatives by F_lag [1/s], damper velocity [N/m] and F_s [1/s]. */
typedef struct {
    double value, by_lagged, by_velocity, by_static;
} Rate;

/* F_lag [N] after a piece. */
double law_advance_lag(const Parameters *p, LagFactors *kept, double lagged, const Piece *piece);
/* dF_lag/dt at F_lag [N], a damper velocity [m/s] and its F_s [N]: the equation that law_advance_lag solves. */
Rate law_rate(const Parameters *p, double lagged, double velocity, double static_force);
/* The reason why the law's own parameters contradict each other, or NULL. */
const char *law_refuses(const Parameters *p);

#endif
