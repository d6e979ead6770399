/* A shock at one corner in several setups at once (port.c): its law and its port. */
#ifndef EIGHTPOST_PORT_H
#define EIGHTPOST_PORT_H

#include "lanes.h" /* before files that use its names */

#include "component.h"
#include "laws.h"

/* Largest number of pieces of a step, as in common/shock.c. */
enum { MOST_PIECES = 1000 };

/* Laws; Polylinear and those with a lag differ only in numbers. */
enum { WITHOUT_LAG = 0, WITH_LAG = 1, HYSTERESIS = 2 };

typedef struct {
    real force, static_force, lagged_force, lag_weight, dissipated_power, beyond_fit;
} PortSignals;

/* Python fills parameters and laws; the rest is the state of a run. */
typedef struct {
    Parameters parameters;
    Index law;
    PortSignals now;
    real lagged, travel; /* F_lag, or the lagged velocity of Hysteresis; the travel of its stop */
    double step; /* for which factors are known */
    int some_lag, some_hysteresis;
    int known; /* piece counts with known factors: 1 to this one */
    real rise[MOST_PIECES + 1], ramp[MOST_PIECES + 1];
} Port;

/* Start at a velocity [m/s] and a displacement [m] of the port. */
void start_port(Port *port, real velocity, real displacement);
/* Advance by h [s] while the velocity changes linearly; in setups that are not `active` the law rests. */
void step_port(Port *port, real from, real to, real displacement, double h, truth active);

#endif
