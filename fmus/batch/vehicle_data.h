/* In place of the generated vehicle_data.h: the same names for a vehicle that is data. */
#ifndef EIGHTPOST_VEHICLE_DATA_H
#define EIGHTPOST_VEHICLE_DATA_H

#include "car.h"

/* The vehicle of this thread. */
static _Thread_local const Car *this_car;

#define SIGMA this_car->sigma
#define OMEGA this_car->omega
#define FASTEST this_car->fastest
#define COUPLING this_car->coupling
#define COUPLED_AT_REST this_car->coupled_at_rest
#define FASTEST_COUPLED this_car->fastest_coupled
#define B this_car->into
#define C this_car->out
#define PORT_INPUT this_car->port_input
#define PORT_OUTPUT this_car->port_output
#define SPRING_PORT this_car->spring_port
#define SPRING_OUTPUT this_car->spring_output
#define MOBILITY this_car->mobility
#define HAS_EQUILIBRIUM this_car->has_equilibrium

#endif
