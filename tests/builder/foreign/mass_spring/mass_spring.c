/* A mass on a spring and a damper, for FMI 2.0 co-simulation, written without code of this project, as another tool
 * would write it: internal Euler steps of 10 ms for any step of the host, and an undeclared log category.
 *
 * Faults, by definition:
 *   RESET_KEEPS_TIME   fmi2Reset restores the values but not the time, as in 20-sim's FMUs: the mass then stands still
 *   RESET_FAILS_AFTER  fmi2Reset does not restore the speed after this number of internal steps
 *   ENDS_AT            no fault: from this time on a step ends the simulation (fmi2Discard, fmi2Terminated)
 *   STOPS_AT           not a fault of the reset: beyond this time a step is an error
 *   HANGS_AT           a step from this time on never returns
 *   HANGS_IN_...       fmi2Terminate, or fmi2Instantiate of the second instance, never returns */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "fmi2Functions.h"

#define GUID "7d0c1b0e5a0d4f7c9b1e2f3a4b5c6d7e"
#define OWN_STEP 0.01 /* s */

enum { FORCE, STIFFNESS, DAMPING, POSITION, SPEED, REALS };

typedef struct {
    double at[REALS], time, stop;
    volatile long steps;
    int limited, ended;
} Mass;

#if defined HANGS_IN_INSTANTIATE || defined HANGS_IN_TERMINATE
static volatile int alive, calls;
#endif

static void defaults(Mass *m)
{
    m->at[FORCE] = 0.0;
    m->at[STIFFNESS] = 40.0;
    m->at[DAMPING] = 1.0;
    m->at[POSITION] = 1.0;
    m->at[SPEED] = 0.0;
}

const char *fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }
const char *fmi2GetVersion(void) { return fmi2Version; }

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                              const fmi2CallbackFunctions *functions, fmi2Boolean visible, fmi2Boolean logging)
{
    Mass *m;
    (void)resources, (void)visible, (void)logging;
#ifdef HANGS_IN_INSTANTIATE
    while (alive) {
        calls++;
    }
    alive = 1;
#endif
    if (type != fmi2CoSimulation || strcmp(guid, GUID) != 0) {
        functions->logger(functions->componentEnvironment, name, fmi2Error, "refusals", "not for this");
        return NULL;
    }
    m = calloc(1, sizeof *m);
    defaults(m);
    return m;
}

void fmi2FreeInstance(fmi2Component c) { free(c); }

fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t n, const fmi2String categories[])
{
    (void)c, (void)on, (void)n, (void)categories;
    return fmi2OK;
}

fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean tolerance_defined, fmi2Real tolerance, fmi2Real start,
                               fmi2Boolean stop_defined, fmi2Real stop)
{
    Mass *m = c;
    (void)tolerance_defined, (void)tolerance;
#ifdef RESET_KEEPS_TIME
    m->time = m->steps == 0 ? start : m->time;
#else
    m->time = start;
#endif
    m->limited = stop_defined;
    m->stop = stop;
    return fmi2OK;
}

fmi2Status fmi2EnterInitializationMode(fmi2Component c) { (void)c; return fmi2OK; }
fmi2Status fmi2ExitInitializationMode(fmi2Component c) { (void)c; return fmi2OK; }

fmi2Status fmi2Terminate(fmi2Component c)
{
    (void)c;
#ifdef HANGS_IN_TERMINATE
    for (;;) {
        calls++;
    }
#endif
    return fmi2OK;
}

fmi2Status fmi2Reset(fmi2Component c)
{
    Mass *m = c;
    const double speed = m->at[SPEED];
    defaults(m);
#ifdef RESET_FAILS_AFTER
    m->at[SPEED] = m->steps > RESET_FAILS_AFTER ? speed : m->at[SPEED];
#endif
#ifndef RESET_KEEPS_TIME
    m->steps = 0;
#endif
    m->ended = 0;
    (void)speed;
    return fmi2OK;
}

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real time, fmi2Real h, fmi2Boolean final)
{
    Mass *m = c;
    (void)final;
    if (m->limited && time + h > m->stop + 1e-9) {
        return fmi2Error;
    }
#ifdef ENDS_AT
    if (time >= ENDS_AT) {
        m->ended = 1;
        return fmi2Discard;
    }
#endif
#ifdef STOPS_AT
    if (time >= STOPS_AT) {
        return fmi2Error;
    }
#endif
#ifdef HANGS_AT
    while (time >= HANGS_AT) {
        m->steps++;
    }
#endif
    while (m->time < time + h - 1e-12) {
        const double a = m->at[FORCE] - m->at[STIFFNESS] * m->at[POSITION] - m->at[DAMPING] * m->at[SPEED];
        m->at[POSITION] += OWN_STEP * m->at[SPEED];
        m->at[SPEED] += OWN_STEP * a;
        m->time += OWN_STEP;
        m->steps++;
    }
    return fmi2OK;
}

fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Real value[])
{
    size_t k;
    for (k = 0; k < n; k++) {
        if (vr[k] >= REALS) {
            return fmi2Error;
        }
        value[k] = ((Mass *)c)->at[vr[k]];
    }
    return fmi2OK;
}

fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Real value[])
{
    size_t k;
    for (k = 0; k < n; k++) {
        if (vr[k] >= REALS || !isfinite(value[k])) {
            return fmi2Error;
        }
        ((Mass *)c)->at[vr[k]] = value[k];
    }
    return fmi2OK;
}

#define NONE(kind, type) \
    fmi2Status fmi2Get##kind(fmi2Component c, const fmi2ValueReference vr[], size_t n, type value[]) \
    { (void)c, (void)vr, (void)value; return n == 0 ? fmi2OK : fmi2Error; }
#define NONE_SET(kind, type) \
    fmi2Status fmi2Set##kind(fmi2Component c, const fmi2ValueReference vr[], size_t n, const type value[]) \
    { (void)c, (void)vr, (void)value; return n == 0 ? fmi2OK : fmi2Error; }
NONE(Integer, fmi2Integer) NONE_SET(Integer, fmi2Integer)
NONE(Boolean, fmi2Boolean) NONE_SET(Boolean, fmi2Boolean)
NONE(String, fmi2String) NONE_SET(String, fmi2String)

fmi2Status fmi2GetBooleanStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Boolean *value)
{
    *value = kind == fmi2Terminated && ((Mass *)c)->ended;
    return fmi2OK;
}
