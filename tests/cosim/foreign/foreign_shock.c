/* A shock unlike ours: mm/s and mm in, positive in rebound; kN out. F = c2 u + k d + x with x' = (c1 u - x) / tau, exact for
   ramps. -DNO_SLOPES and -DNO_STATE leave out functions; the description must agree. Steps above 5 m/s are refused.
   -DLAST=... is done instead of a step after 0.1 s. */
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "fmi2Functions.h"

enum { SPEED = 11, TRAVEL = 12, FORCE = 40 };
static const double C1 = 0.002, C2 = 0.001, K = 0.01, TAU = 0.004; /* kN.s/mm, kN/mm, s */

typedef struct {
    double u[2], slope[2], x, time;
} State;

typedef struct {
    State now;
    const fmi2CallbackFunctions *callbacks;
} Shock;

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                              const fmi2CallbackFunctions *callbacks, fmi2Boolean visible, fmi2Boolean logging)
{
    Shock *s = calloc(1, sizeof *s);
    (void)name, (void)type, (void)guid, (void)resources, (void)visible, (void)logging;
    s->callbacks = callbacks;
    return s;
}

void fmi2FreeInstance(fmi2Component c) { free(c); }

fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean use, fmi2Real tolerance, fmi2Real start, fmi2Boolean stops,
                               fmi2Real stop)
{
    (void)use, (void)tolerance, (void)stops, (void)stop;
    ((Shock *)c)->now.time = start;
    return fmi2OK;
}

fmi2Status fmi2EnterInitializationMode(fmi2Component c) { return c == NULL ? fmi2Error : fmi2OK; }

fmi2Status fmi2ExitInitializationMode(fmi2Component c)
{
    State *s = &((Shock *)c)->now;
    s->x = C1 * s->u[0];
    return fmi2OK;
}

fmi2Status fmi2Terminate(fmi2Component c) { return c == NULL ? fmi2Error : fmi2OK; }

fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Real value[])
{
    for (size_t k = 0; k < n; k++) {
        ((Shock *)c)->now.u[vr[k] == TRAVEL] = value[k];
    }
    return fmi2OK;
}

fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Real value[])
{
    const State *s = &((Shock *)c)->now;
    for (size_t k = 0; k < n; k++) {
        value[k] = vr[k] == FORCE ? C2 * s->u[0] + K * s->u[1] + s->x : s->u[vr[k] == TRAVEL];
    }
    return fmi2OK;
}

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real time, fmi2Real h, fmi2Boolean final)
{
    State *s = &((Shock *)c)->now;
    const double from = C1 * s->u[0], rise = C1 * s->slope[0] * h, decay = exp(-h / TAU);
    (void)final;
#ifdef LAST
    if (time > 0.1) {
        LAST;
    }
#endif
    if (fabs(s->u[0] + s->slope[0] * h) > 5000.0 || fabs(time - s->time) > 1e-9 || !(h > 0.0)) {
        ((Shock *)c)->callbacks->logger(NULL, "shock", fmi2Error, "log", "the piston is too fast, or the time is wrong");
        return fmi2Error;
    }
    s->x = s->x * decay + from * (1.0 - decay) + rise * (1.0 - (1.0 - decay) * TAU / h);
    for (int k = 0; k < 2; k++) {
        s->u[k] += s->slope[k] * h;
        s->slope[k] = 0.0;
    }
    s->time = time + h;
    return fmi2OK;
}

#ifndef NO_SLOPES
fmi2Status fmi2SetRealInputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Integer order[],
                                       const fmi2Real value[])
{
    for (size_t k = 0; k < n; k++) {
        if (order[k] != 1) {
            return fmi2Error;
        }
        ((Shock *)c)->now.slope[vr[k] == TRAVEL] = value[k];
    }
    return fmi2OK;
}
#endif

#ifndef NO_STATE
fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *state)
{
    if (*state == NULL) {
        *state = malloc(sizeof(State));
    }
    memcpy(*state, &((Shock *)c)->now, sizeof(State));
    return fmi2OK;
}

fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate state)
{
    memcpy(&((Shock *)c)->now, state, sizeof(State));
    return fmi2OK;
}

fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *state)
{
    (void)c;
    free(*state);
    *state = NULL;
    return fmi2OK;
}
#endif
