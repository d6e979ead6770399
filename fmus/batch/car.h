/* A vehicle as data: what vehicle_data.h of its FMU contains as constants, and its parameters. Python fills it
 * (cosim/study/batch/car.py). */
#ifndef EIGHTPOST_CAR_H
#define EIGHTPOST_CAR_H

#include "sizes.h"

/* Friction and springs at the ports, with the names of the FMU's parameters. */
typedef struct {
    double friction_force[PORTS], friction_velocity[PORTS];
    double bristle_force[PORTS], bristle_reach[PORTS], bristle_static_ratio[PORTS], bristle_stribeck_velocity[PORTS];
    double port_spring[SPRINGS];
} CarParameters;

/* Numbers first, then integers, so that there is no padding between them. */
typedef struct {
    double sigma[MODES], omega[MODES], fastest;
    double coupling[COUPLED_CELLS], coupled_at_rest[COUPLED_CELLS], fastest_coupled;
    double into[STATE_BLOCKS][INPUTS][BLOCK], out[OUTPUTS][STATE_COUNT];
    double direct[DIRECT_TERMS], mobility[PORTS], offset[OUTPUTS];
    CarParameters parameters;
    int direct_begin[OUTPUTS + 1], direct_input[DIRECT_TERMS];
    int port_input[PORTS], port_output[PORTS], spring_port[SPRINGS], spring_output[SPRINGS];
    int at_equilibrium, has_equilibrium, has_offset[OUTPUTS];
} Car;

#endif
