/* Friction at a port, in parallel with its shock (eightpost/vehicle/friction.py, eightpost/vehicle/bristle.py):
 *     F_c tanh(v / v_f) + F_s z / z_s,   z' = v - |v| z / z_b(v),   z_b = z_s (1 + (rho - 1) e^(-(v / v_s)^2))
 * with the port's velocity v and the deflection z of its bristle. */
#ifndef EIGHTPOST_FRICTION_H
#define EIGHTPOST_FRICTION_H

#include "elementary.h"
#include "real.h"

/* Part (rho - 1) e^(-(v / v_s)^2) of z_b / z_s. */
static inline real static_excess(double ratio, double stribeck_velocity, real v)
{
    const real relative = v / uniform(stribeck_velocity);
    const double excess = ratio - 1.0;
    return excess == 0.0 ? uniform(0.0) : uniform(excess) * exponential(-relative * relative);
}

/* The deflection after h seconds, exact for a constant velocity v; `limit` is z_b(v). */
static inline real bent_bristle(real bend, real v, real limit, real h)
{
    const real travel = either(v < 0.0, -v, v) * h, end = either(v < 0.0, -limit, limit);
    return bend - (end - bend) * exponential_minus_1(-travel / limit);
}

#endif
