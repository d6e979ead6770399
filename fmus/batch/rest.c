/* Factors of a step, sub-steps and steady states, from the files of the vehicle's FMU. */
#include "rest.h"

#include <string.h>

#include "vehicle_component.h"

#include "factors.h"
#include "steady_state.h"
#include "sub_steps.h"

void find_factors(const Car *car, void *factors, double h)
{
    this_car = car;
    discretise((Factors *)factors, h);
}

int count_sub_steps(const Car *car, double h)
{
    this_car = car;
    return sub_steps(&car->parameters, h);
}

int find_rest(const Car *car, const double *inputs, double *z)
{
    Modal found;
    Message why = {0};
    this_car = car;
    memset(&found, 0, sizeof found);
    if (car->at_equilibrium && !(HAS_EQUILIBRIUM && rest(&car->parameters, inputs, &found, &why))) {
        return 0;
    }
    memcpy(z, found.at, STATE_COUNT * sizeof *z);
    return 1;
}

double exponential_minus_1_of(double x)
{
    return exponential_minus_1(x);
}
