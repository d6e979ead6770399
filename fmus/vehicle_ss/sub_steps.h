/* The number of sub-steps of a step with friction and springs at the ports. */
#ifndef EIGHTPOST_SUB_STEPS_H
#define EIGHTPOST_SUB_STEPS_H

#include "modal.h"
#include "steady_state.h"

/* A sub-step is at most this share of the fastest time constant of the friction that creeps, and of a radian of the fastest swinging
 * on bristles and springs, with the stiffness of the springs at a displacement of SPRING_TRAVEL [m]. */
static const double SUB_STEP_SHARE = 0.0625, SUB_STEP_ANGLE = 0.125, SPRING_TRAVEL = 0.05;
static const double MOST_SUB_STEPS = 100000.0;

/* 1/s: the sum over the ports of the friction's slope at zero velocity times the port's mobility. */
static double friction_rate(const Parameters *p)
{
    double rate = 0.0;
    for (int i = 0; i < PORT_COUNT; i++) {
        rate += p->friction_force[i] / p->friction_velocity[i] * MOBILITY[i];
    }
    return rate;
}

/* rad2/s2: the sum over the ports of the stiffness of bristle and spring times the port's mobility. */
static double squared_frequency(const Parameters *p)
{
    double stiffness[PORTS], sum = 0.0;
    for (int i = 0; i < PORT_COUNT; i++) {
        stiffness[i] = p->bristle_force[i] / p->bristle_reach[i];
    }
    for (int s = 0; s < SPRING_COUNT; s++) {
        stiffness[SPRING_PORT[s]] += 2.0 * SPRING_TRAVEL * magnitude(p->port_spring[s]);
    }
    for (int i = 0; i < PORT_COUNT; i++) {
        sum += stiffness[i] * MOBILITY[i];
    }
    return sum;
}

static int whole_number_above(double count)
{
    const int whole = (int)count;
    return whole < 1 ? 1 : whole + ((double)whole < count);
}

/* The number of sub-steps of a step; 0 if there are too many. */
static int sub_steps(const Parameters *p, double h)
{
    const double creeping = h * friction_rate(p) / SUB_STEP_SHARE, angle = h / SUB_STEP_ANGLE;
    const double square = angle * angle * squared_frequency(p);
    if (!(creeping >= 0.0 && creeping <= MOST_SUB_STEPS && square <= MOST_SUB_STEPS * MOST_SUB_STEPS)) {
        return 0;
    }
    int count = whole_number_above(creeping);
    while ((double)count * (double)count < square) { /* takes less time than the sub-steps */
        count++;
    }
    return count;
}

#endif
