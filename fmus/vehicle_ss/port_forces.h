/* Friction and springs at the ports, in parallel with the shocks (eightpost/vehicle/friction.py, eightpost/vehicle/bristle.py):
 *     F_c tanh(v / v_f) + F_s z / z_s + k2 d^2,   z' = v - |v| z / z_b(v),   z_b = z_s (1 + (rho - 1) e^(-(v / v_s)^2))
 * with a port's velocity v and displacement d, and the deflection z of its bristle. */
#ifndef EIGHTPOST_PORT_FORCES_H
#define EIGHTPOST_PORT_FORCES_H

#include "friction.h"
#include "modal.h"

static inline int has_bristles(const Parameters *p)
{
    int any = 0;
    for (int i = 0; i < PORT_COUNT; i++) {
        any |= p->bristle_force[i] > 0.0;
    }
    return any;
}

/* Whether the ports have any force of their own. */
static inline int has_port_forces(const Parameters *p)
{
    int any = 0;
    for (int i = 0; i < PORT_COUNT; i++) {
        any |= p->friction_force[i] > 0.0;
        any |= p->bristle_force[i] > 0.0;
    }
    for (int s = 0; s < SPRING_COUNT; s++) {
        any |= p->port_spring[s] != 0.0;
    }
    return any;
}

static inline void port_velocities(const real *z, real *v)
{
    for (int i = 0; i < PORT_COUNT; i++) {
        v[i] = row_times(C[PORT_OUTPUT[i]], z);
    }
}

/* The forces in state z, with the ports' velocities there. */
static inline void port_forces(const Parameters *p, const real *z, const real *v, const real *bend, real *force)
{
    for (int i = 0; i < PORT_COUNT; i++) {
        force[i] = uniform(0.0);
        if (p->friction_force[i] > 0.0) {
            force[i] = p->friction_force[i] * hyperbolic_tangent(v[i] / p->friction_velocity[i]);
        }
        if (p->bristle_force[i] > 0.0) {
            force[i] += p->bristle_force[i] / p->bristle_reach[i] * bend[i];
        }
    }
    for (int s = 0; s < SPRING_COUNT; s++) {
        if (p->port_spring[s] != 0.0) {
            const real d = row_times(C[SPRING_OUTPUT[s]], z);
            force[SPRING_PORT[s]] += p->port_spring[s] * (d * d);
        }
    }
}

static inline void add_to_inputs(const real *force, real *u)
{
    for (int i = 0; i < PORT_COUNT; i++) {
        u[PORT_INPUT[i]] += force[i];
    }
}

/* The inputs' increase by the forces in state z. */
static inline void add_port_forces(const Parameters *p, const real *z, const real *bend, real *u)
{
    real v[PORTS], force[PORTS];
    port_velocities(z, v);
    port_forces(p, z, v, bend, force);
    add_to_inputs(force, u);
}

/* Part (rho - 1) e^(-(v / v_s)^2) of z_b / z_s of port i. */
static inline real static_excess_at(const Parameters *p, int i, real v)
{
    return static_excess(p->bristle_static_ratio[i], p->bristle_stribeck_velocity[i], v);
}

/* z_b(v): the deflection at which the bristle of port i slides. */
static inline real sliding_deflection(const Parameters *p, int i, real v)
{
    return p->bristle_reach[i] * (1.0 + static_excess_at(p, i, v));
}

/* The bristles' deflections after h seconds from `bend`, exact for constant velocities; those without force stay. */
static inline void bend_bristles(const Parameters *p, const real *bend, const real *v0, const real *v1, double h, real *bent)
{
    for (int i = 0; i < PORT_COUNT; i++) {
        bent[i] = bend[i];
        if (p->bristle_force[i] > 0.0) {
            const real v = 0.5 * (v0[i] + v1[i]);
            bent[i] = bent_bristle(bend[i], v, sliding_deflection(p, i, v), h);
        }
    }
}

#endif
