/* A driven van der Pol oscillator for FMI 2.0 co-simulation, written without code of this project, as another tool
 * would write it:
 *
 *     x' = v,   v' = mu (1 - x^2) v - x + u
 *
 * by the classical Runge-Kutta method, the input held over each step. There are no FMU states, no derivatives,
 * and only the state machine that the standard requires. */
#include <math.h>
#include <string.h>

#include "fmi2Functions.h"

#define GUID "{6a1c7c0e-3f61-4c0b-9d0b-2b1d8f0c7a55}"
#define LABEL_SIZE 64

enum { TIME, X, DER_X, V, DER_V, MU, U, ENERGY, TWO_MU, REALS };
enum { STEPS, SUBSTEPS, INTEGERS };
enum { FROZEN, RISING, BOOLEANS };

typedef struct {
    double r[REALS];
    int i[INTEGERS];
    int b[BOOLEANS];
    char label[LABEL_SIZE];
    int limited;
    double stop;
    fmi2CallbackFreeMemory release;
} Oscillator;

static double acceleration(const Oscillator *o, double x, double v)
{
    return o->r[MU] * (1.0 - x * x) * v - x + o->r[U];
}

static void derive(Oscillator *o)
{
    double *r = o->r;
    r[DER_X] = r[V];
    r[DER_V] = acceleration(o, r[X], r[V]);
    r[ENERGY] = 0.5 * (r[X] * r[X] + r[V] * r[V]);
    r[TWO_MU] = 2.0 * r[MU];
    o->b[RISING] = r[V] > 0.0;
}

static void defaults(Oscillator *o)
{
    memset(o->r, 0, sizeof o->r);
    memset(o->i, 0, sizeof o->i);
    memset(o->b, 0, sizeof o->b);
    o->r[X] = 2.0;
    o->r[MU] = 1.5;
    o->i[SUBSTEPS] = 4;
    strcpy(o->label, "Oscillator & co");
    o->limited = 0;
    derive(o);
}

static void runge_kutta(Oscillator *o, double h)
{
    const double x = o->r[X], v = o->r[V];
    const double kx1 = v, kv1 = acceleration(o, x, v);
    const double kx2 = v + 0.5 * h * kv1, kv2 = acceleration(o, x + 0.5 * h * kx1, kx2);
    const double kx3 = v + 0.5 * h * kv2, kv3 = acceleration(o, x + 0.5 * h * kx2, kx3);
    const double kx4 = v + h * kv3, kv4 = acceleration(o, x + h * kx3, kx4);
    o->r[X] = x + h / 6.0 * (kx1 + 2.0 * kx2 + 2.0 * kx3 + kx4);
    o->r[V] = v + h / 6.0 * (kv1 + 2.0 * kv2 + 2.0 * kv3 + kv4);
}

const char *fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }
const char *fmi2GetVersion(void) { return fmi2Version; }

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                              const fmi2CallbackFunctions *functions, fmi2Boolean visible, fmi2Boolean logging)
{
    Oscillator *o;
    (void)resources, (void)visible, (void)logging;
    if (type != fmi2CoSimulation || strcmp(guid, GUID) != 0) {
        functions->logger(functions->componentEnvironment, name, fmi2Error, "logStatusError", "wrong GUID or type");
        return NULL;
    }
    o = functions->allocateMemory(1, sizeof *o);
    if (o != NULL) {
        o->release = functions->freeMemory;
        defaults(o);
    }
    return o;
}

void fmi2FreeInstance(fmi2Component c)
{
    if (c != NULL) {
        ((Oscillator *)c)->release(c);
    }
}

fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t n, const fmi2String categories[])
{
    (void)c, (void)on, (void)n, (void)categories;
    return fmi2OK;
}

fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean tolerance_defined, fmi2Real tolerance, fmi2Real start,
                               fmi2Boolean stop_defined, fmi2Real stop)
{
    Oscillator *o = c;
    (void)tolerance_defined, (void)tolerance;
    o->r[TIME] = start;
    o->limited = stop_defined;
    o->stop = stop;
    return fmi2OK;
}

fmi2Status fmi2EnterInitializationMode(fmi2Component c) { (void)c; return fmi2OK; }
fmi2Status fmi2ExitInitializationMode(fmi2Component c) { derive(c); return fmi2OK; }
fmi2Status fmi2Terminate(fmi2Component c) { (void)c; return fmi2OK; }
fmi2Status fmi2Reset(fmi2Component c) { defaults(c); return fmi2OK; }

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real time, fmi2Real h, fmi2Boolean final)
{
    Oscillator *o = c;
    int k;
    (void)final;
    if (!(h > 0.0) || (o->limited && time + h > o->stop + 1e-9 * (1.0 + fabs(o->stop)))) {
        return fmi2Error;
    }
    for (k = 0; k < o->i[SUBSTEPS] && !o->b[FROZEN]; k++) {
        runge_kutta(o, h / o->i[SUBSTEPS]);
    }
    o->r[TIME] = time + h;
    o->i[STEPS]++;
    derive(o);
    return fmi2OK;
}

#define ACCESSORS(Type, member, count)                                                                                \
    fmi2Status fmi2Get##Type(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2##Type value[])            \
    {                                                                                                                 \
        size_t k;                                                                                                     \
        for (k = 0; k < n; k++) {                                                                                     \
            if (vr[k] >= count) { return fmi2Error; }                                                                 \
            value[k] = ((Oscillator *)c)->member[vr[k]];                                                              \
        }                                                                                                             \
        return fmi2OK;                                                                                                \
    }                                                                                                                 \
    fmi2Status fmi2Set##Type(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2##Type value[])      \
    {                                                                                                                 \
        size_t k;                                                                                                     \
        for (k = 0; k < n; k++) {                                                                                     \
            if (vr[k] >= count) { return fmi2Error; }                                                                 \
            ((Oscillator *)c)->member[vr[k]] = value[k];                                                              \
        }                                                                                                             \
        derive(c);                                                                                                    \
        return fmi2OK;                                                                                                \
    }

ACCESSORS(Real, r, REALS)
ACCESSORS(Integer, i, INTEGERS)
ACCESSORS(Boolean, b, BOOLEANS)

fmi2Status fmi2GetString(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2String value[])
{
    size_t k;
    for (k = 0; k < n; k++) {
        if (vr[k] != 0) { return fmi2Error; }
        value[k] = ((Oscillator *)c)->label;
    }
    return fmi2OK;
}

fmi2Status fmi2SetString(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2String value[])
{
    size_t k;
    for (k = 0; k < n; k++) {
        if (vr[k] != 0 || strlen(value[k]) >= LABEL_SIZE) { return fmi2Error; }
        strcpy(((Oscillator *)c)->label, value[k]);
    }
    return fmi2OK;
}
