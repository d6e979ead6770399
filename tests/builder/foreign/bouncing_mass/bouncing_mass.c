/* A mass that falls on a floor and bounces, for FMI 2.0 co-simulation, written without code of this project, as another
 * tool would write it: one static instance, fixed step size, its own memory management, FMU states.
 *
 *     h'' = push / m - g,   at the floor h' becomes -e h'
 *
 * Between impacts the flight is a parabola, which a step follows exactly; impacts are found on it. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "fmi2Functions.h"

#define GUID "0f4b9f0d2f0f4b4d8f6a5d2f6b0c9e11"
#define GRAVITY 9.81
#define CREEP 1e-3 /* m/s: below this speed the mass is at rest */

enum { H, V, MASS, PUSH, HEIGHT, SPEED };
enum { BOUNCES, PHASE, FLOOR };
enum { FLYING = 1, RESTING = 2 };
enum { STONE = 1, RUBBER = 2 };

typedef struct {
    double h, v, mass, push, time, step, stop;
    int bounces, phase, floor, limited;
} Ball;

static struct {
    int used;
    Ball ball;
} the;

static void defaults(void)
{
    memset(&the.ball, 0, sizeof the.ball);
    the.ball.h = 1.0;
    the.ball.mass = 0.5;
    the.ball.phase = FLYING;
    the.ball.floor = RUBBER;
}

static double restitution(void) { return the.ball.floor == RUBBER ? 0.8 : 0.5; }

/* The time after which h + v t + a t^2 / 2 reaches the floor, at most `left`. */
static double impact(const Ball *b, double a, double left)
{
    double root = b->v * b->v - 2.0 * a * b->h, t;
    if (root < 0.0 || (a >= 0.0 && b->v >= 0.0)) {
        return left;
    }
    t = a == 0.0 ? -b->h / b->v : (-b->v - sqrt(root)) / a;
    return t > 0.0 && t < left ? t : left;
}

static void fall(double left)
{
    Ball *b = &the.ball;
    int guard;
    for (guard = 0; guard < 100 && left > 0.0; guard++) {
        const double a = b->push / b->mass - GRAVITY;
        double t;
        if (b->phase == RESTING && a <= 0.0) {
            return;
        }
        b->phase = FLYING;
        t = impact(b, a, left);
        b->h += t * (b->v + 0.5 * a * t);
        b->v += a * t;
        if (t < left) {
            b->h = 0.0;
            b->v = -restitution() * b->v;
            b->bounces++;
            if (b->v < CREEP) {
                b->v = 0.0;
                b->phase = RESTING;
            }
        }
        left -= t;
    }
}

const char *fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }
const char *fmi2GetVersion(void) { return fmi2Version; }

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                              const fmi2CallbackFunctions *functions, fmi2Boolean visible, fmi2Boolean logging)
{
    (void)name, (void)resources, (void)functions, (void)visible, (void)logging;
    if (type != fmi2CoSimulation || strcmp(guid, GUID) != 0 || the.used) {
        return NULL;
    }
    the.used = 1;
    defaults();
    return &the;
}

void fmi2FreeInstance(fmi2Component c)
{
    if (c != NULL) {
        the.used = 0;
    }
}

fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t n, const fmi2String categories[])
{
    (void)c, (void)on, (void)categories;
    return n == 0 ? fmi2OK : fmi2Error;
}

fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean tolerance_defined, fmi2Real tolerance, fmi2Real start,
                               fmi2Boolean stop_defined, fmi2Real stop)
{
    (void)c, (void)tolerance_defined, (void)tolerance;
    the.ball.time = start;
    the.ball.limited = stop_defined;
    the.ball.stop = stop;
    return fmi2OK;
}

fmi2Status fmi2EnterInitializationMode(fmi2Component c) { (void)c; return fmi2OK; }
fmi2Status fmi2ExitInitializationMode(fmi2Component c) { (void)c; return fmi2OK; }
fmi2Status fmi2Terminate(fmi2Component c) { (void)c; return fmi2OK; }
fmi2Status fmi2Reset(fmi2Component c) { (void)c; defaults(); return fmi2OK; }

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real time, fmi2Real h, fmi2Boolean final)
{
    Ball *b = &the.ball;
    (void)c, (void)final;
    if (!(h > 0.0) || (b->step > 0.0 && fabs(h - b->step) > 1e-9 * b->step)) {
        return fmi2Error; /* canHandleVariableCommunicationStepSize is false */
    }
    if (b->limited && time + h > b->stop + 0.5 * h) {
        return fmi2Error;
    }
    b->step = h;
    b->time = time + h;
    fall(h);
    return fmi2OK;
}

static double *real(fmi2ValueReference vr)
{
    switch (vr) {
    case H: case HEIGHT: return &the.ball.h;
    case V: case SPEED: return &the.ball.v;
    case MASS: return &the.ball.mass;
    case PUSH: return &the.ball.push;
    default: return NULL;
    }
}

static int *integer(fmi2ValueReference vr)
{
    switch (vr) {
    case BOUNCES: return &the.ball.bounces;
    case PHASE: return &the.ball.phase;
    case FLOOR: return &the.ball.floor;
    default: return NULL;
    }
}

#define ACCESSORS(Type, find, c_type)                                                                                 \
    fmi2Status fmi2Get##Type(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2##Type value[])            \
    {                                                                                                                 \
        size_t k;                                                                                                     \
        (void)c;                                                                                                      \
        for (k = 0; k < n; k++) {                                                                                     \
            const c_type *found = find(vr[k]);                                                                        \
            if (found == NULL) { return fmi2Error; }                                                                  \
            value[k] = *found;                                                                                        \
        }                                                                                                             \
        return fmi2OK;                                                                                                \
    }                                                                                                                 \
    fmi2Status fmi2Set##Type(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2##Type value[])      \
    {                                                                                                                 \
        size_t k;                                                                                                     \
        (void)c;                                                                                                      \
        for (k = 0; k < n; k++) {                                                                                     \
            c_type *found = find(vr[k]);                                                                              \
            if (found == NULL) { return fmi2Error; }                                                                  \
            *found = value[k];                                                                                        \
        }                                                                                                             \
        return fmi2OK;                                                                                                \
    }

ACCESSORS(Real, real, double)
ACCESSORS(Integer, integer, int)

fmi2Status fmi2GetBoolean(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Boolean value[])
{
    (void)c, (void)vr, (void)value;
    return n == 0 ? fmi2OK : fmi2Error;
}

fmi2Status fmi2SetBoolean(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Boolean value[])
{
    (void)c, (void)vr, (void)value;
    return n == 0 ? fmi2OK : fmi2Error;
}

fmi2Status fmi2GetString(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2String value[])
{
    (void)c, (void)vr, (void)value;
    return n == 0 ? fmi2OK : fmi2Error;
}

fmi2Status fmi2SetString(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2String value[])
{
    (void)c, (void)vr, (void)value;
    return n == 0 ? fmi2OK : fmi2Error;
}

fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *state)
{
    (void)c;
    if (*state == NULL) {
        *state = malloc(sizeof(Ball));
    }
    if (*state == NULL) {
        return fmi2Error;
    }
    memcpy(*state, &the.ball, sizeof(Ball));
    return fmi2OK;
}

fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate state)
{
    (void)c;
    memcpy(&the.ball, state, sizeof(Ball));
    return fmi2OK;
}

fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *state)
{
    (void)c;
    free(*state);
    *state = NULL;
    return fmi2OK;
}

fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate state, size_t *size)
{
    (void)c, (void)state;
    *size = sizeof(Ball);
    return fmi2OK;
}

fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate state, fmi2Byte bytes[], size_t size)
{
    (void)c;
    memcpy(bytes, state, size);
    return fmi2OK;
}

fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte bytes[], size_t size, fmi2FMUstate *state)
{
    (void)c;
    if (size != sizeof(Ball) || (*state = malloc(size)) == NULL) {
        return fmi2Error;
    }
    memcpy(*state, bytes, size);
    return fmi2OK;
}
