/* Laws that are compiled from the files of their FMUs, in several setups at once. Where a step is not `needed`, nothing changes. */
#ifndef EIGHTPOST_LAWS_H
#define EIGHTPOST_LAWS_H

#include "lanes.h" /* before files that use its names */

#include "component.h"

/* A piece of time in which the damper velocity [m/s] and F_s [N] change linearly; the same as Piece of common/shock.h. */
typedef struct {
    real velocity_start, static_start, velocity_end, static_end, step;
} Span;

/* The lagged velocity [m/s] and the travel of the stop [m]. */
typedef struct {
    real velocity, travel;
} Lagged;

Lagged hysteresis_start(const Parameters *p, real velocity);
Lagged hysteresis_after(const Parameters *p, Lagged before, const Span *span, truth needed);
/* The force [N] at a damper velocity [m/s] and its F_s [N]. */
real hysteresis_force(const Parameters *p, Lagged lagged, real velocity, real static_force);

#endif
