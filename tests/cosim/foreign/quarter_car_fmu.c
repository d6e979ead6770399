/* A quarter car (-DCAR) or its shock, as exported by a tool that keeps its own time.

   Car:   300 kg and 40 kg, 20 kN/m between them, 200 kN/m to the road; the shock's force pushes them apart.
   Shock: 0.005 s F' = 1500 v - F.
   fmi2Reset is that of 20-sim's FMUs: it restores the variables, not the time up to which the FMU has integrated.
   With -DSTATIC_MEMORY the state is static in the library, so a new instance continues with the old state. */
#include <math.h>
#include <string.h>

#include "fmi2Functions.h"

#ifdef CAR
enum { STATES = 4, INPUTS = 2 }; /* z, v of the body, z, v of the wheel; force, road */
#else
enum { STATES = 1, INPUTS = 2 }; /* force; velocity, displacement */
#endif

static const double SUBSTEP = 5e-5;

typedef struct {
    const fmi2CallbackFunctions *callbacks;
    double own[STATES], u[INPUTS], slope[INPUTS], time;
    double *x;
} Instance;

#ifdef STATIC_MEMORY
static double states[STATES];
#endif

static void derivatives(const double *x, const double *u, double *dx)
{
#ifdef CAR
    const double spring = 20000.0 * (x[2] - x[0]);
    dx[0] = x[1];
    dx[1] = (spring + u[0]) / 300.0;
    dx[2] = x[3];
    dx[3] = (200000.0 * (u[1] - x[2]) - spring - u[0]) / 40.0;
#else
    dx[0] = (1500.0 * u[0] - x[0]) / 0.005;
#endif
}

static void inputs_at(const Instance *i, double since, double *u)
{
    for (int k = 0; k < INPUTS; k++) {
        u[k] = i->u[k] + i->slope[k] * since;
    }
}

/* The classical Runge-Kutta method, from `since` after the communication point. */
static void substep(Instance *i, double since, double h)
{
    static const double at[4] = {0.0, 0.5, 0.5, 1.0}, weight[4] = {1.0, 2.0, 2.0, 1.0};
    double u[INPUTS], y[STATES], d[STATES] = {0.0}, sum[STATES] = {0.0};
    for (int stage = 0; stage < 4; stage++) {
        for (int k = 0; k < STATES; k++) {
            y[k] = i->x[k] + at[stage] * h * d[k];
        }
        inputs_at(i, since + at[stage] * h, u);
        derivatives(y, u, d);
        for (int k = 0; k < STATES; k++) {
            sum[k] += weight[stage] * d[k];
        }
    }
    for (int k = 0; k < STATES; k++) {
        i->x[k] += h / 6.0 * sum[k];
    }
}

static void start_values(Instance *i)
{
    memset(i->u, 0, sizeof i->u);
    memset(i->slope, 0, sizeof i->slope);
#ifndef STATIC_MEMORY
    memset(i->x, 0, sizeof i->own);
#endif
}

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                              const fmi2CallbackFunctions *callbacks, fmi2Boolean visible, fmi2Boolean logging)
{
    Instance *i = callbacks->allocateMemory(1, sizeof *i);
    i->callbacks = callbacks;
    i->time = 0.0;
#ifdef STATIC_MEMORY
    i->x = states;
#else
    i->x = i->own;
#endif
    start_values(i);
    return i;
}

void fmi2FreeInstance(fmi2Component c) { ((Instance *)c)->callbacks->freeMemory(c); }

fmi2Status fmi2Reset(fmi2Component c)
{
    start_values(c); /* the time is not reset */
    return fmi2OK;
}

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real time, fmi2Real step, fmi2Boolean final)
{
    Instance *i = c;
    while (i->time < time + step - 1e-12) {
        const double h = fmin(SUBSTEP, time + step - i->time);
        substep(i, i->time - time, h);
        i->time += h;
    }
    inputs_at(i, step, i->u);
    memset(i->slope, 0, sizeof i->slope);
    return fmi2OK;
}

static double value_of(const Instance *i, fmi2ValueReference vr)
{
    if (vr < INPUTS) {
        return i->u[vr];
    }
#ifdef CAR
    const double outputs[] = {i->x[3] - i->x[1], i->x[2] - i->x[0], 200000.0 * (i->u[1] - i->x[2]), i->x[0]};
    return outputs[vr - 10];
#else
    return i->x[0];
#endif
}

fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Real value[])
{
    for (size_t k = 0; k < n; k++) {
        value[k] = value_of(c, vr[k]);
    }
    return fmi2OK;
}

fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Real value[])
{
    for (size_t k = 0; k < n; k++) {
        ((Instance *)c)->u[vr[k]] = value[k];
        ((Instance *)c)->slope[vr[k]] = 0.0;
    }
    return fmi2OK;
}

fmi2Status fmi2SetRealInputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Integer o[],
                                       const fmi2Real value[])
{
    for (size_t k = 0; k < n; k++) {
        ((Instance *)c)->slope[vr[k]] = value[k];
    }
    return fmi2OK;
}

#include "accepted_calls.h"
