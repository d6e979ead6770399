/* In place of common/component.h: the parameters of a shock with any law, which Python fills (eightpost/machine/car.py). */
#ifndef EIGHTPOST_COMPONENT_H
#define EIGHTPOST_COMPONENT_H

#include <float.h>
#include <stddef.h>
#include <stdint.h>

#include "names.h"
#include "real.h"

#define NO_LIMIT DBL_MAX

typedef struct {
    real motion_ratio, compression_scale, rebound_scale, gas_stiffness, gas_preload, seal_friction, friction_velocity;
    real curve_transition_speed, curve_transition_width, curve_compression_speed, curve_rebound_speed;
    real curve_compression_slope, curve_rebound_slope;
    real curve_inner[15], curve_compression[4], curve_rebound[4];
    real curve_knot_velocity[25], curve_knot_force[25], curve_knot_slope[25];
    real time_constant, lag_full_force, lag_zero_force; /* the limits also distinguish laws without and with lag only */
    real time_constants[3], stop_stiffness, stop_yield, stop_time, curve_lagged_slope[25]; /* of Hysteresis */
    /* from here on derived from the numbers above (port.c) */
    real per_curve_transition_speed, per_curve_transition_width, per_lag_range, lag_share;
    real growth[2]; /* ln of the ratio of tau at high speed to that at rest: rebound, compression */
} Parameters;

/* Those that Python fills. */
enum { PARAMETERS = offsetof(Parameters, per_curve_transition_speed) / sizeof(real) };

/* Signals of a port, which only functions for model exchange use. */
typedef struct {
    real velocity, lagged_force, lagged_velocity, stop_travel;
} Signals;

#endif
