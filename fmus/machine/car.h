/* The vehicle of a machine: linear around a damper at each port, in coordinates in which it is a set of independent pairs of states.
 * Python fills it (eightpost/machine/linear.py). */
#ifndef EIGHTPOST_CAR_H
#define EIGHTPOST_CAR_H

#include "sizes.h"

/* A step's start, middle and end: a force is a quadratic through its values there. */
enum { AT_START, AT_MIDDLE, AT_END, NODES };
enum { STATES = 2 * PAIRS };

/* Friction in parallel with the shock at a port, as in vehicle_ss/friction.h. */
typedef struct {
    double friction_force, friction_velocity, bristle_force, bristle_reach, bristle_static_ratio, bristle_stribeck_velocity;
    double port_spring;
} PortFriction;

/* Forces are those beyond the damper: G = F - c v. */
typedef struct {
    double turn[PAIRS][2]; /* e^(lambda h) */
    double load[NODES][STATES][CORNERS]; /* a step's states by the forces */
    double rest[STATES][CORNERS]; /* the states at rest by constant forces */
    double velocity[CORNERS][STATES], travel[CORNERS][STATES]; /* of the ports */
    double moved[NODES][CORNERS][CORNERS], travelled[NODES][CORNERS][CORNERS]; /* velocity and travel at the end by the forces */
    double damping[CORNERS]; /* c [N.s/m] */
    PortFriction friction[CORNERS];
} Car;

#endif
