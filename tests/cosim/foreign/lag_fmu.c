/* A lag as an FMU of FMI 3.0, or of FMI 2.0 with -DFMI=2, so that a test can compare both builds of the same equations:

       x' = u + f - x,  y = x + u,  z' = w (an array of 2),  v = z

   All inputs change linearly over a step, and the step is exact. The parameter `manner` selects a fault at 0.5 s. With
   -DSTRICT a communication point must be the sum of the steps to the bit, with -DONLY=h every step must be h, and with
   -DNAN_FROM=t the output x is not a number after t. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#ifndef FMI
#define FMI 3
#endif
#if FMI == 3
#include "fmi3Functions.h"
#else
#include "fmi2Functions.h"
#endif

enum { TIME, U, X, Y, W, V, F, S, GEAR, SEEN, FLAG, COUNT, M, SUM, MANNER, BIG, NAMES, AT };

typedef struct {
    double time, u, f, w[2], slope, x, z[2], m[4], largest;
    int gear, flag, dead;
    char manner[32];
} Model;

static int is(const Model *m, const char *manner) { return strcmp(m->manner, manner) == 0; }

static void start_values(Model *m)
{
    *m = (Model){.w = {1.0, 2.0}, .m = {1.0, 2.0, 3.0, 4.0}, .gear = 4};
}

/* Step over h while u + f changes linearly from a to b, and w from w0 to w. */
static void advance(Model *m, double h, double a, double b, const double *w0)
{
    const double slope = (b - a) / h, decay = exp(-h);
    m->x = m->x * decay + (a - slope) * (1.0 - decay) + slope * h;
    for (int k = 0; k < 2; k++) {
        m->z[k] += 0.5 * (w0[k] + m->w[k]) * h;
    }
    m->time += h;
#ifdef NAN_FROM
    m->x = m->time > NAN_FROM ? NAN : m->x;
#endif
}

static int refuses(const Model *m, double time, double h)
{
#ifdef STRICT
    return time != m->time;
#elif defined ONLY
    return fabs(h - ONLY) > 1e-9;
#else
    return 0;
#endif
}

#if FMI == 3

typedef struct {
    Model model;
    fmi3InstanceEnvironment environment;
    fmi3LogMessageCallback log;
    fmi3IntermediateUpdateCallback update;
    size_t required;
} Instance;

static Instance *live(fmi3Instance c)
{
    Instance *i = c;
    if (i->model.dead) {
        abort(); /* after fmi3Fatal no function may be called */
    }
    return i;
}

fmi3Instance fmi3InstantiateCoSimulation(fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
                                         fmi3Boolean log_on, fmi3Boolean events, fmi3Boolean early,
                                         const fmi3ValueReference required[], size_t count,
                                         fmi3InstanceEnvironment environment, fmi3LogMessageCallback log,
                                         fmi3IntermediateUpdateCallback update)
{
    const size_t length = strlen(resources);
    if (events || early || length == 0 || resources[length - 1] != '/' || strncmp(resources, "file:", 5) == 0) {
        return NULL;
    }
    Instance *i = calloc(1, sizeof *i);
    i->environment = environment;
    i->log = log;
    i->update = update;
    i->required = count;
    start_values(&i->model);
    return i;
}

void fmi3FreeInstance(fmi3Instance c) { free(live(c)); }

fmi3Status fmi3EnterInitializationMode(fmi3Instance c, fmi3Boolean has_tolerance, fmi3Float64 tolerance,
                                       fmi3Float64 start, fmi3Boolean has_stop, fmi3Float64 stop)
{
    live(c)->model.time = start;
    return fmi3OK;
}

static fmi3Status fault(Instance *i, double time, double h, fmi3Boolean *terminate, double *reached)
{
    Model *m = &i->model;
    if (is(m, "terminate")) {
        *terminate = true;
        *reached = time;
    } else if (is(m, "stop early")) {
        *reached = time + 0.25 * h;
    } else if (is(m, "discard")) {
        *reached = time + 0.25 * h;
        return fmi3Discard;
    } else if (is(m, "error") || is(m, "fatal")) {
        m->dead = is(m, "fatal");
        i->log(i->environment, m->dead ? fmi3Fatal : fmi3Error, "log", "100 % of #1# and #12# is lost; ##");
        return m->dead ? fmi3Fatal : fmi3Error;
    }
    return fmi3OK;
}

fmi3Status fmi3DoStep(fmi3Instance c, fmi3Float64 time, fmi3Float64 h, fmi3Boolean final, fmi3Boolean *event,
                      fmi3Boolean *terminate, fmi3Boolean *early, fmi3Float64 *reached)
{
    Instance *i = live(c);
    Model *m = &i->model;
    *event = *terminate = *early = false;
    *reached = time + h;
    if (refuses(m, time, h)) {
        return fmi3Error;
    }
    if (time > 0.4995 && strcmp(m->manner, "") != 0) {
        const fmi3Status status = fault(i, time, h, terminate, reached);
        if (status != fmi3OK || *terminate || *reached < time + h) {
            return status;
        }
    }
    const double a = m->u + m->f, w0[2] = {m->w[0], m->w[1]};
    fmi3Boolean requested = true;
    double never = 0.0;
#ifndef NO_UPDATE
    if (is(m, "look")) { /* an update without a request must not change an input */
        i->update(i->environment, time + 0.5 * h, false, true, false, false, &requested, &never);
    } else if (is(m, "halves")) {
        i->update(i->environment, time + 0.5 * h, true, true, false, true, &requested, &never);
        const double middle = m->u + m->f, w1[2] = {m->w[0], m->w[1]};
        advance(m, 0.5 * h, a, middle, w0);
        i->update(i->environment, time + h, true, true, false, true, &requested, &never);
        advance(m, 0.5 * h, middle, m->u + m->f, w1);
        return requested ? fmi3Error : fmi3OK;
    } else {
        i->update(i->environment, time + h, true, true, false, true, &requested, &never);
    }
#endif
    advance(m, h, a, m->u + m->f, w0);
    return is(m, "warn") ? fmi3Warning : fmi3OK;
}

fmi3Status fmi3SetFloat64(fmi3Instance c, const fmi3ValueReference vr[], size_t n, const fmi3Float64 v[], size_t count)
{
    Model *m = &live(c)->model;
    const double *from = v;
    for (size_t k = 0; k < n; k++) {
        switch (vr[k]) {
        case U: m->u = *from++; break;
        case W: memcpy(m->w, from, sizeof m->w); from += 2; break;
        case M: memcpy(m->m, from, sizeof m->m); from += 4; break;
        default: return fmi3Error;
        }
    }
    return (size_t)(from - v) == count ? fmi3OK : fmi3Error;
}

fmi3Status fmi3GetFloat64(fmi3Instance c, const fmi3ValueReference vr[], size_t n, fmi3Float64 v[], size_t count)
{
    const Instance *i = live(c);
    const Model *m = &i->model;
    double *to = v;
    for (size_t k = 0; k < n; k++) {
        switch (vr[k]) {
        case TIME: *to++ = m->time; break;
        case U: *to++ = m->u; break;
        case X: *to++ = m->x; break;
        case Y: *to++ = m->x + m->u; break;
        case W: memcpy(to, m->w, sizeof m->w); to += 2; break;
        case V: memcpy(to, m->z, sizeof m->z); to += 2; break;
        case M: memcpy(to, m->m, sizeof m->m); to += 4; break;
        case SUM: *to++ = m->m[0] + 10.0 * m->m[1] + 100.0 * m->m[2] + 1000.0 * m->m[3]; break;
        case NAMES: *to++ = (double)i->required; break;
        default: return fmi3Error;
        }
    }
    return (size_t)(to - v) == count ? fmi3OK : fmi3Error;
}

fmi3Status fmi3SetFloat32(fmi3Instance c, const fmi3ValueReference vr[], size_t n, const fmi3Float32 v[], size_t count)
{
    live(c)->model.f = v[0];
    return n == 1 && count == 1 && vr[0] == F ? fmi3OK : fmi3Error;
}

fmi3Status fmi3GetFloat32(fmi3Instance c, const fmi3ValueReference vr[], size_t n, fmi3Float32 v[], size_t count)
{
    const Model *m = &live(c)->model;
    v[0] = (float)(vr[0] == F ? m->f : m->x);
    return n == 1 && count == 1 && (vr[0] == F || vr[0] == S) ? fmi3OK : fmi3Error;
}

fmi3Status fmi3SetInt32(fmi3Instance c, const fmi3ValueReference vr[], size_t n, const fmi3Int32 v[], size_t count)
{
    live(c)->model.gear = v[0];
    return n == 1 && vr[0] == GEAR ? fmi3OK : fmi3Error;
}

fmi3Status fmi3GetInt32(fmi3Instance c, const fmi3ValueReference vr[], size_t n, fmi3Int32 v[], size_t count)
{
    const Model *m = &live(c)->model;
    v[0] = vr[0] == SEEN ? 10 * m->gear + m->flag : m->gear;
    return n == 1 ? fmi3OK : fmi3Error;
}

fmi3Status fmi3GetInt64(fmi3Instance c, const fmi3ValueReference vr[], size_t n, fmi3Int64 v[], size_t count)
{
    v[0] = 1LL << (int)live(c)->model.gear;
    return n == 1 && vr[0] == BIG ? fmi3OK : fmi3Error;
}

fmi3Status fmi3SetBoolean(fmi3Instance c, const fmi3ValueReference vr[], size_t n, const fmi3Boolean v[], size_t count)
{
    live(c)->model.flag = v[0];
    return n == 1 && vr[0] == FLAG ? fmi3OK : fmi3Error;
}

fmi3Status fmi3SetString(fmi3Instance c, const fmi3ValueReference vr[], size_t n, const fmi3String v[], size_t count)
{
    strncpy(live(c)->model.manner, v[0], sizeof live(c)->model.manner - 1);
    return n == 1 && vr[0] == MANNER ? fmi3OK : fmi3Error;
}

fmi3Status fmi3ExitInitializationMode(fmi3Instance c) { live(c); return fmi3OK; }
fmi3Status fmi3Terminate(fmi3Instance c) { live(c); return fmi3OK; }

#ifndef SPARSE
fmi3Status fmi3Reset(fmi3Instance c) { start_values(&live(c)->model); return fmi3OK; }
fmi3Status fmi3SetDebugLogging(fmi3Instance c, fmi3Boolean on, size_t n, const fmi3String names[]) { return fmi3OK; }

fmi3Status fmi3GetFMUState(fmi3Instance c, fmi3FMUState *state)
{
    Model *kept = *state ? *state : malloc(sizeof *kept);
    *kept = live(c)->model;
    *state = kept;
    return fmi3OK;
}

fmi3Status fmi3SetFMUState(fmi3Instance c, fmi3FMUState state)
{
    live(c)->model = *(Model *)state;
    return fmi3OK;
}

fmi3Status fmi3FreeFMUState(fmi3Instance c, fmi3FMUState *state)
{
    free(*state);
    *state = NULL;
    return fmi3OK;
}

fmi3Status fmi3GetDirectionalDerivative(fmi3Instance c, const fmi3ValueReference unknowns[], size_t n,
                                        const fmi3ValueReference knowns[], size_t m, const fmi3Float64 seed[],
                                        size_t seeds, fmi3Float64 result[], size_t results)
{
    if (n != 1 || (unknowns[0] != Y && unknowns[0] != V) || m != 1 || knowns[0] != U || seeds != 1 || results != 1) {
        return fmi3Error;
    }
    result[0] = 3.0 * seed[0];
    return fmi3OK;
}
#endif

#else

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                              const fmi2CallbackFunctions *callbacks, fmi2Boolean visible, fmi2Boolean log_on)
{
    Model *m = calloc(1, sizeof *m);
    start_values(m);
    return m;
}

void fmi2FreeInstance(fmi2Component c) { free(c); }

fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean td, fmi2Real t, fmi2Real start, fmi2Boolean sd, fmi2Real s)
{
    ((Model *)c)->time = start;
    return fmi2OK;
}

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real time, fmi2Real h, fmi2Boolean final)
{
    Model *m = c;
    if (refuses(m, time, h)) {
        return fmi2Error;
    }
    const double a = m->u + m->f, w0[2] = {m->w[0], m->w[1]};
    m->u = m->u + m->slope * h;
    m->slope = 0.0;
    advance(m, h, a, m->u + m->f, w0);
    return fmi2OK;
}

fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Real v[])
{
    ((Model *)c)->u = v[0];
    return n == 1 && vr[0] == U ? fmi2OK : fmi2Error;
}

fmi2Status fmi2SetRealInputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Integer o[],
                                       const fmi2Real v[])
{
    ((Model *)c)->slope = v[0];
    return n == 1 && vr[0] == U ? fmi2OK : fmi2Error;
}

fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Real v[])
{
    const Model *m = c;
    for (size_t k = 0; k < n; k++) {
        v[k] = vr[k] == U ? m->u : vr[k] == X ? m->x : m->x + m->u;
    }
    return fmi2OK;
}

fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *state)
{
    Model *kept = *state ? *state : malloc(sizeof *kept);
    *kept = *(Model *)c;
    *state = kept;
    return fmi2OK;
}

fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate state)
{
    *(Model *)c = *(Model *)state;
    return fmi2OK;
}

fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *state)
{
    free(*state);
    *state = NULL;
    return fmi2OK;
}

fmi2Status fmi2EnterInitializationMode(fmi2Component c) { return fmi2OK; }
fmi2Status fmi2ExitInitializationMode(fmi2Component c) { return fmi2OK; }
fmi2Status fmi2Terminate(fmi2Component c) { return fmi2OK; }
fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t n, const fmi2String names[]) { return fmi2OK; }

#endif
