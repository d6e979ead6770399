/* The vehicle in several setups at once (vehicle.c). */
#ifndef EIGHTPOST_VEHICLE_H
#define EIGHTPOST_VEHICLE_H

#include "lanes.h" /* before files that use its names */

#include "car.h"

/* The state, the inputs that were reached, with the forces of the ports, and the bristles' deflections. */
typedef struct {
    real z[STATE_BLOCKS * BLOCK], reached[INPUTS], bend[PORTS];
} Vehicle;

/* Start at the state of constant inputs. Returns in which setups there is one. */
truth start_vehicle(const Car *car, Vehicle *vehicle, const real *inputs);
/* Begin a run: no factors of a step are known. */
void forget_factors(void);
/* Advance by h [s], with inputs that change linearly. Returns in which setups the state stays in bounds. */
truth step_vehicle(const Car *car, Vehicle *vehicle, const real *from, const real *to, double h);
/* An output. */
real vehicle_output(const Car *car, const Vehicle *vehicle, int output);

#endif
