/* Three filters and their sum, for co-simulation and model exchange of FMI 3.0, written without code of this project:
 * arrays, a structural parameter, an enumeration, clocks, event mode, and an output that is a state.
 *
 * Faults, by definition:
 *   ANOTHER_GAIN    the second gain starts with another value than in modelDescription.xml
 *   STATES          this number of states is reported; it is four
 *   ANOTHER_VERSION fmi3GetVersion returns "3.1"
 *   ENDS_AT         no fault: from this time on a step ends the simulation (terminateSimulation) */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "fmi3Functions.h"

#define TOKEN "{3b0c5e7a-1f42-4a5e-9a53-6d1c8e20f7b4}"
#define OWN_STEP 0.01 /* s */
#ifndef STATES
#define STATES 4
#endif

enum { N = 3, FLOATS = 4 };
enum { TIME, SIZE, GAINS, OFFSETS, MODE, LABELS, ACTIVE, U, TICK, COUNT, PREVIOUS, X, DER_X, Y, DER_Y, SAMPLING, SAMPLED, RATIO,
       SEED };
enum { CREATED = 1, INITIALIZING = 2, STEPPING = 4, EVENT = 8, CONTINUOUS = 16, ENDED = 32, ANY = 63 };

typedef struct {
    fmi3Float64 time, stop, gains[N], u, x[N + 1], sampled;
    fmi3Float32 offsets[FLOATS], ratio;
    fmi3Int64 mode;
    fmi3UInt64 seed;
    fmi3Boolean active[N];
    fmi3Int32 count, previous;
    int phase, is_limited, is_exchange;
    fmi3InstanceEnvironment environment;
    fmi3LogMessageCallback log;
} Bank;

static void defaults(Bank *b)
{
    const fmi3Float64 gains[N] = {1.0, 2.0, 4.0}, x[N + 1] = {0.0, 0.25, 0.5, 0.25};
    memcpy(b->gains, gains, sizeof gains);
    memcpy(b->x, x, sizeof x);
#ifdef ANOTHER_GAIN
    b->gains[1] = 3.0;
#endif
    for (int k = 0; k < FLOATS; k++) {
        b->offsets[k] = 0.5f;
    }
    b->active[0] = b->active[2] = fmi3True;
    b->active[1] = fmi3False;
    b->ratio = 0.1f;
    b->mode = 8589934592;
    b->seed = 18446744073709551615u;
    b->u = 0.5;
    b->sampled = 0.0;
    b->count = b->previous = 0;
    b->time = 0.0;
    b->phase = CREATED;
}

static fmi3Status refuse(const Bank *b)
{
    if (b != NULL && b->log != NULL) {
        b->log(b->environment, fmi3Error, "refusals", "this call is not possible here");
    }
    return fmi3Error;
}

static fmi3Status turned(fmi3Instance c, int from, int to)
{
    Bank *b = c;
    if (b == NULL || !(b->phase & from)) {
        return refuse(b);
    }
    b->phase = to;
    return fmi3OK;
}

static void slopes(const Bank *b, fmi3Float64 rates[N + 1])
{
    rates[N] = -b->x[N];
    for (int k = 0; k < N; k++) {
        rates[k] = b->gains[k] * (b->u - b->x[k]);
        rates[N] += b->x[k];
    }
}

/* ---- Life ---------------------------------------------------------------------------------------------------------- */

const char *fmi3GetVersion(void)
{
#ifdef ANOTHER_VERSION
    return "3.1";
#else
    return fmi3Version;
#endif
}

static fmi3Instance created(fmi3String token, int is_exchange, fmi3InstanceEnvironment environment,
                            fmi3LogMessageCallback log)
{
    Bank *b;
    if (token == NULL || strcmp(token, TOKEN) != 0) {
        log(environment, fmi3Error, "refusals", "another instantiationToken");
        return NULL;
    }
    b = calloc(1, sizeof *b);
    b->environment = environment;
    b->log = log;
    b->is_exchange = is_exchange;
    defaults(b);
    return b;
}

fmi3Instance fmi3InstantiateCoSimulation(fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
                                         fmi3Boolean logging, fmi3Boolean event_mode, fmi3Boolean early,
                                         const fmi3ValueReference required[], size_t n,
                                         fmi3InstanceEnvironment environment, fmi3LogMessageCallback log,
                                         fmi3IntermediateUpdateCallback update)
{
    (void)name, (void)resources, (void)visible, (void)logging, (void)event_mode, (void)early, (void)required, (void)n;
    (void)update;
    return created(token, 0, environment, log);
}

fmi3Instance fmi3InstantiateModelExchange(fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
                                          fmi3Boolean logging, fmi3InstanceEnvironment environment,
                                          fmi3LogMessageCallback log)
{
    (void)name, (void)resources, (void)visible, (void)logging;
    return created(token, 1, environment, log);
}

void fmi3FreeInstance(fmi3Instance c) { free(c); }

fmi3Status fmi3SetDebugLogging(fmi3Instance c, fmi3Boolean on, size_t n, const fmi3String categories[])
{
    (void)c, (void)on, (void)n, (void)categories;
    return fmi3OK;
}

fmi3Status fmi3EnterInitializationMode(fmi3Instance c, fmi3Boolean has_tolerance, fmi3Float64 tolerance,
                                       fmi3Float64 start, fmi3Boolean has_stop, fmi3Float64 stop)
{
    Bank *b = c;
    (void)has_tolerance, (void)tolerance;
    if (b == NULL || b->phase != CREATED) {
        return refuse(b);
    }
    b->time = start;
    b->stop = stop;
    b->is_limited = has_stop;
    b->phase = INITIALIZING;
    return fmi3OK;
}

fmi3Status fmi3ExitInitializationMode(fmi3Instance c)
{
    return turned(c, INITIALIZING, c != NULL && ((Bank *)c)->is_exchange ? EVENT : STEPPING);
}

fmi3Status fmi3EnterEventMode(fmi3Instance c) { return turned(c, STEPPING | CONTINUOUS, EVENT); }
fmi3Status fmi3EnterStepMode(fmi3Instance c) { return turned(c, EVENT, STEPPING); }
fmi3Status fmi3EnterContinuousTimeMode(fmi3Instance c) { return turned(c, EVENT, CONTINUOUS); }
fmi3Status fmi3Terminate(fmi3Instance c) { return turned(c, STEPPING | EVENT | CONTINUOUS, ENDED); }

fmi3Status fmi3Reset(fmi3Instance c)
{
    if (c == NULL) {
        return fmi3Error;
    }
    defaults(c);
    return fmi3OK;
}

/* ---- Steps and events ---------------------------------------------------------------------------------------------- */

fmi3Status fmi3DoStep(fmi3Instance c, fmi3Float64 time, fmi3Float64 h, fmi3Boolean final, fmi3Boolean *event,
                      fmi3Boolean *terminate, fmi3Boolean *early, fmi3Float64 *last)
{
    Bank *b = c;
    (void)final;
    if (b == NULL || b->phase != STEPPING || b->is_exchange || !(h > 0.0) || !isfinite(h) || fabs(time - b->time) > 1e-6 ||
        (b->is_limited && time + h > b->stop + 1e-9)) {
        return refuse(b);
    }
#ifdef ENDS_AT
    if (time >= ENDS_AT) {
        *terminate = fmi3True;
        *event = *early = fmi3False;
        *last = time;
        return fmi3OK;
    }
#endif
    while (b->time < time + h - 1e-9) {
        fmi3Float64 rates[N + 1];
        slopes(b, rates);
        for (int k = 0; k <= N; k++) {
            b->x[k] += OWN_STEP * rates[k];
        }
        b->time += OWN_STEP;
    }
    b->time = fabs(b->time - time - h) < 1e-9 ? time + h : b->time;
    *event = *terminate = *early = fmi3False;
    *last = b->time;
    return fmi3OK;
}

fmi3Status fmi3UpdateDiscreteStates(fmi3Instance c, fmi3Boolean *more, fmi3Boolean *terminate, fmi3Boolean *nominals,
                                    fmi3Boolean *values, fmi3Boolean *has_next, fmi3Float64 *next)
{
    Bank *b = c;
    if (b == NULL || !(b->phase & EVENT)) {
        return refuse(b);
    }
    b->previous = b->count;
    *more = *terminate = *nominals = *values = *has_next = fmi3False;
    *next = 0.0;
    return fmi3OK;
}

/* ---- Model exchange ------------------------------------------------------------------------------------------------ */

static int is_array(const Bank *b, int phases, size_t n)
{
    return b != NULL && b->is_exchange && b->phase & phases && n == N + 1;
}

fmi3Status fmi3SetTime(fmi3Instance c, fmi3Float64 time)
{
    Bank *b = c;
    if (b == NULL || b->phase != CONTINUOUS) {
        return refuse(b);
    }
    b->time = time;
    return fmi3OK;
}

fmi3Status fmi3SetContinuousStates(fmi3Instance c, const fmi3Float64 x[], size_t n)
{
    Bank *b = c;
    if (!is_array(b, CONTINUOUS, n)) {
        return refuse(b);
    }
    memcpy(b->x, x, sizeof b->x);
    return fmi3OK;
}

fmi3Status fmi3GetContinuousStates(fmi3Instance c, fmi3Float64 x[], size_t n)
{
    const Bank *b = c;
    if (!is_array(b, INITIALIZING | EVENT | CONTINUOUS, n)) {
        return refuse(b);
    }
    memcpy(x, b->x, sizeof b->x);
    return fmi3OK;
}

fmi3Status fmi3GetContinuousStateDerivatives(fmi3Instance c, fmi3Float64 rates[], size_t n)
{
    const Bank *b = c;
    if (!is_array(b, INITIALIZING | EVENT | CONTINUOUS, n)) {
        return refuse(b);
    }
    slopes(b, rates);
    return fmi3OK;
}

fmi3Status fmi3GetNominalsOfContinuousStates(fmi3Instance c, fmi3Float64 nominals[], size_t n)
{
    if (!is_array(c, ANY, n)) {
        return refuse(c);
    }
    for (size_t k = 0; k < n; k++) {
        nominals[k] = 1.0;
    }
    return fmi3OK;
}

fmi3Status fmi3GetEventIndicators(fmi3Instance c, fmi3Float64 indicators[], size_t n)
{
    (void)indicators;
    return n == 0 ? fmi3OK : refuse(c);
}

fmi3Status fmi3CompletedIntegratorStep(fmi3Instance c, fmi3Boolean final, fmi3Boolean *event, fmi3Boolean *terminate)
{
    (void)final;
    *event = *terminate = fmi3False;
    return ((Bank *)c)->phase == CONTINUOUS ? fmi3OK : refuse(c);
}

fmi3Status fmi3GetNumberOfContinuousStates(fmi3Instance c, size_t *n)
{
    (void)c;
    *n = STATES;
    return fmi3OK;
}

fmi3Status fmi3GetNumberOfEventIndicators(fmi3Instance c, size_t *n)
{
    (void)c;
    *n = 0;
    return fmi3OK;
}

/* ---- Variables: values of arrays follow one another ---------------------------------------------------------------- */

#define ACCESS(kind)                                                                                                   \
    static const void *place_of_##kind(Bank *b, fmi3ValueReference r, int is_set, size_t *n);                          \
    fmi3Status fmi3Get##kind(fmi3Instance c, const fmi3ValueReference vr[], size_t n, fmi3##kind values[], size_t all) \
    {                                                                                                                  \
        size_t done = 0, own = 0;                                                                                      \
        for (size_t k = 0; k < n; k++, done += own) {                                                                  \
            const void *from = place_of_##kind(c, vr[k], 0, &own);                                                     \
            if (from == NULL || done + own > all) {                                                                    \
                return refuse(c);                                                                                      \
            }                                                                                                          \
            memcpy(values + done, from, own * sizeof *values);                                                         \
        }                                                                                                              \
        return done == all ? fmi3OK : refuse(c);                                                                       \
    }                                                                                                                  \
    fmi3Status fmi3Set##kind(fmi3Instance c, const fmi3ValueReference vr[], size_t n, const fmi3##kind values[],       \
                             size_t all)                                                                               \
    {                                                                                                                  \
        size_t done = 0, own = 0;                                                                                      \
        for (size_t k = 0; k < n; k++, done += own) {                                                                  \
            void *to = (void *)place_of_##kind(c, vr[k], 1, &own);                                                     \
            if (to == NULL || done + own > all) {                                                                      \
                return refuse(c);                                                                                      \
            }                                                                                                          \
            memcpy(to, values + done, own * sizeof *values);                                                           \
        }                                                                                                              \
        return done == all ? fmi3OK : refuse(c);                                                                       \
    }                                                                                                                  \
    static const void *place_of_##kind(Bank *b, fmi3ValueReference r, int is_set, size_t *n)

ACCESS(Float64)
{
    static _Thread_local fmi3Float64 rates[N + 1];
    if (is_set && !(r == GAINS || r == U || ((r == X || r == Y) && b->phase & (CREATED | INITIALIZING)))) {
        return NULL;
    }
    slopes(b, rates);
    *n = r == GAINS || r == X || r == DER_X ? N : 1;
    return r == TIME ? &b->time : r == GAINS ? b->gains : r == U ? &b->u : r == X ? b->x : r == DER_X ? rates
         : r == Y ? b->x + N : r == DER_Y ? rates + N : r == SAMPLED ? &b->sampled : NULL;
}

ACCESS(Float32)
{
    (void)is_set;
    *n = r == OFFSETS ? FLOATS : 1;
    return r == OFFSETS ? b->offsets : r == RATIO ? &b->ratio : NULL;
}

ACCESS(UInt64)
{
    static const fmi3UInt64 size = N;
    *n = 1;
    return r == SEED ? (const void *)&b->seed : r == SIZE && !is_set ? &size : NULL;
}

ACCESS(Int64)
{
    (void)is_set;
    *n = 1;
    return r == MODE ? &b->mode : NULL;
}

ACCESS(Boolean)
{
    (void)is_set;
    *n = N;
    return r == ACTIVE ? b->active : NULL;
}

ACCESS(Int32)
{
    *n = 1;
    return is_set ? NULL : r == COUNT ? &b->count : r == PREVIOUS ? &b->previous : NULL;
}

ACCESS(String)
{
    static const fmi3String labels[2] = {"low and slow", "high"};
    (void)b;
    *n = 2;
    return r == LABELS && !is_set ? labels : NULL;
}

fmi3Status fmi3GetClock(fmi3Instance c, const fmi3ValueReference vr[], size_t n, fmi3Clock values[])
{
    for (size_t k = 0; k < n; k++) {
        if (vr[k] != TICK && vr[k] != SAMPLING) {
            return refuse(c);
        }
        values[k] = fmi3ClockInactive;
    }
    return fmi3OK;
}

fmi3Status fmi3SetClock(fmi3Instance c, const fmi3ValueReference vr[], size_t n, const fmi3Clock values[])
{
    Bank *b = c;
    for (size_t k = 0; k < n; k++) {
        if (b->phase != EVENT || (vr[k] != TICK && vr[k] != SAMPLING)) {
            return refuse(b);
        }
        b->count = vr[k] == TICK && values[k] ? b->previous + 1 : b->count;
        b->sampled = vr[k] == SAMPLING && values[k] ? b->u : b->sampled;
    }
    return fmi3OK;
}
