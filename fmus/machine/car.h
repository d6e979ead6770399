/* The vehicle of a machine: linear around a damper at each port, in coordinates in which it is a set of independent pairs of states.
 * Python fills it (eightpost/machine/car.py). */
#ifndef EIGHTPOST_CAR_H
#define EIGHTPOST_CAR_H

#include "number.h"
#include "sizes.h"

/* A force is a quadratic through its values at a step's start, middle and end; the end is the start of the next step. */
enum { MIDDLE_OF_STEP, END_OF_STEP, NODES };
enum { STATES = 2 * PAIRS, FORCES = NODES * CORNERS };

/* Friction in parallel with the shock at a port, as in vehicle_ss/friction.h. */
typedef struct {
    number friction_force, friction_velocity, bristle_force, bristle_reach, bristle_static_ratio, bristle_stribeck_velocity;
    number port_spring;
} PortFriction;

/* Forces are those beyond the damper, G = F - c v: those in the middle of a step, then those at its end. The states are those at the
 * end without them. */
typedef struct {
    number turn[PAIRS][2]; /* e^(lambda h) */
    number load[STATES][FORCES]; /* a step's states by the forces of the step before */
    number rest[STATES][CORNERS], sunk[CORNERS][CORNERS]; /* states and travel at rest by constant forces */
    number velocity[CORNERS][STATES], travel[CORNERS][STATES]; /* of the ports */
    number moved[CORNERS][FORCES], travelled[CORNERS][FORCES]; /* velocity and travel at the end by the forces of the step */
    number damping[CORNERS]; /* c [N.s/m] */
    PortFriction friction[CORNERS];
} Car;

#endif
