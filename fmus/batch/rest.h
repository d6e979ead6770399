/* What a vehicle needs once per run, or once per setup at its start (rest.c). */
#ifndef EIGHTPOST_REST_H
#define EIGHTPOST_REST_H

#include "car.h"

/* The factors of a step of h [s]: `factors` is a Factors of modal.h. */
void find_factors(const Car *car, void *factors, double h);
/* The number of sub-steps of a step of h [s] with friction or springs at the ports; 0 if there are too many. */
int count_sub_steps(const Car *car, double h);
/* e^x - 1 of one number, where exponential_minus_1 is that of lanes. */
double exponential_minus_1_of(double x);
/* The state (STATE_COUNT) at which constant inputs (INPUTS) start; 0 if no such state exists. */
int find_rest(const Car *car, const double *inputs, double *z);

#endif
