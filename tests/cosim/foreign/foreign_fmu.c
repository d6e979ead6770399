/* An FMU unlike ours: mm/s in, kN out with the sign reversed, value references with gaps, and faults on request.

   y = -3 u / 1000 [kN], angle = x [deg] with x' = u; the parameter `manner` selects the fault at 0.5 s. A call after
   fmi2Fatal, or one that fmi2Pending does not allow, ends the process. */
#define _POSIX_C_SOURCE 200809L
#include <fenv.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "fmi2Functions.h"

/* As the standard header does with FMI2_FUNCTION_PREFIX. */
#ifdef WITH_PREFIX
#undef fmi2FullName
#define fmi2FullName(name) foreign_##name
#endif

enum { U = 1000, Y = 7, ANGLE = 400000, LATE = 12, LENGTH = 20, SEEN = 21, MADE = 22, GEAR = 3, FLAG = 4, MANNER = 5 };

typedef struct {
    const fmi2CallbackFunctions *callbacks;
    char name[64], resources[4096], manner[64];
    double u, x, late, reached;
    int gear, flag, dead, pending, ended, own_memory;
} Instance;

static int instances, made;

static int is(const Instance *i, const char *manner) { return strcmp(i->manner, manner) == 0; }

static Instance *live(fmi2Component c)
{
    Instance *i = c;
    if (i->dead) {
        abort(); /* after fmi2Fatal no function may be called */
    }
    return i;
}

static void say(Instance *i, fmi2Status status, const char *format, int number, const char *text, double real)
{
    i->callbacks->logger(i->callbacks->componentEnvironment, i->name, status, "log", format, number, text, real);
}

static void start_values(Instance *i)
{
    i->u = i->x = i->reached = 0.0;
    i->late = NAN;
    i->gear = 4;
    i->flag = i->pending = i->ended = 0;
    strcpy(i->manner, "polite");
}

/* The path of a file URI, with percent encoding decoded. */
static void path_of(const char *uri, char *path)
{
    const char *from = strncmp(uri, "file://", 7) == 0 ? uri + 7 : "";
    for (; *from; from++) {
        unsigned code;
        if (*from == '%' && sscanf(from + 1, "%2x", &code) == 1) {
            *path++ = (char)code;
            from += 2;
        } else {
            *path++ = *from;
        }
    }
    *path = 0;
}

static double resource_length(Instance *i)
{
    char path[8192], text[64] = "";
    path_of(i->resources, path);
    strcat(path, "/note.txt");
    FILE *file = fopen(path, "r");
    if (file == NULL) {
        return -1.0;
    }
    const double length = (double)fread(text, 1, sizeof text, file);
    fclose(file);
    return length;
}

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                              const fmi2CallbackFunctions *callbacks, fmi2Boolean visible, fmi2Boolean logging)
{
    if ((instances > 0 && strcmp(guid, "{once}") == 0) || (strcmp(guid, "{tool}") == 0 && getenv("FOREIGN_TOOL") == NULL)) {
        return NULL;
    }
    if (strcmp(guid, "{no birth}") == 0) {
        _exit(0);
    }
    instances++;
    made++;
    const int own = strcmp(guid, "{own memory}") == 0;
    Instance *i = own ? calloc(1, sizeof *i) : callbacks->allocateMemory(1, sizeof *i);
    i->own_memory = own;
    i->callbacks = callbacks;
    strncpy(i->name, name, sizeof i->name - 1);
    strncpy(i->resources, resources, sizeof i->resources - 1);
    start_values(i);
    return i;
}

void fmi2FreeInstance(fmi2Component c)
{
    Instance *i = live(c);
    if (i->pending) {
        abort(); /* fmi2CancelStep must be called first */
    }
    instances--;
    if (i->own_memory) {
        free(i);
    } else {
        i->callbacks->freeMemory(i);
    }
}

fmi2Status fmi2Reset(fmi2Component c)
{
    if (is(live(c), "no reset")) {
        return fmi2Error;
    }
    start_values(c);
    return fmi2OK;
}

fmi2Status fmi2EnterInitializationMode(fmi2Component c)
{
    if (is(live(c), "hang at start")) {
        for (;;) {
            pause();
        }
    }
    if (is(c, "exit at start")) {
        exit(0);
    }
    if (is(c, "change all at start")) {
        fesetround(FE_DOWNWARD);
        return chdir("/") == 0 ? fmi2OK : fmi2Error;
    }
    return fmi2OK;
}

/* Faults that occur immediately; fmi2OK if there is none. */
static fmi2Status misbehave(Instance *i, double time)
{
    if (is(i, "abort")) {
        say(i, fmi2Warning, "pressure %d is %s, %.2f bar", 7, "low", 0.25);
        printf("solver: assertion failed\n");
        abort();
    }
    if (is(i, "segfault")) {
        *(volatile int *)8 = 1;
    }
    if (is(i, "hang")) {
        for (;;) {
            pause();
        }
    }
    if (is(i, "exit") || is(i, "exit with 0")) {
        exit(is(i, "exit") ? 3 : 0);
    }
    if (is(i, "_exit with 0")) {
        _exit(0);
    }
    if (is(i, "change folder") && chdir("/") != 0) {
        return fmi2Error;
    }
    if (is(i, "round up")) {
        fesetround(FE_UPWARD);
    }
    if (is(i, "fatal") || is(i, "error")) {
        i->dead = is(i, "fatal");
        say(i, i->dead ? fmi2Fatal : fmi2Error, "matrix %d of %s is singular, pivot %g", 3, "#r1000#", 0.0);
        return i->dead ? fmi2Fatal : fmi2Error;
    }
    if (is(i, "end")) {
        i->ended = 1;
        i->reached = time;
        return fmi2Discard;
    }
    if (is(i, "pending")) {
        i->pending = 1;
        return fmi2Pending;
    }
    return is(i, "unknown status") ? 17 : fmi2OK;
}

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real time, fmi2Real step, fmi2Boolean final)
{
    Instance *i = live(c);
    if (is(i, "slow")) {
        usleep(200000);
    }
    const fmi2Status status = time > 0.4995 ? misbehave(i, time) : fmi2OK;
    if (status != fmi2OK) {
        return status;
    }
    if (is(i, "discard") && step > 1.5e-3) {
        i->reached = time + 1e-3;
        return fmi2Discard;
    }
    if (is(i, "talk")) {
        say(i, fmi2OK, "step %d of %s is %.1f %% done; ##1", 5, "#i3#", 12.34);
    }
    if (is(i, "print")) {
        printf("solved at %g\n", time);
    }
    if (is(i, "write")) {
        FILE *file = fopen("solver.log", "a");
        fprintf(file, "%g\n", time);
        fclose(file);
    }
    if (is(i, "start process") && fork() == 0) {
        for (;;) {
            pause();
        }
    }
    i->x += i->u * step;
    i->late = i->x;
    return fmi2OK;
}

fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Real value[])
{
    Instance *i = live(c);
    for (size_t k = 0; k < n; k++) {
        switch (vr[k]) {
        case U: value[k] = i->u; break;
        case Y: value[k] = -3.0 * i->u / 1000.0; break;
        case ANGLE: value[k] = i->x; break;
        case LATE: value[k] = i->late; break;
        case LENGTH: value[k] = resource_length(i); break;
        case SEEN: value[k] = i->gear + 100 * i->flag; break;
        case MADE: value[k] = made; break;
        default: return fmi2Error;
        }
    }
    return fmi2OK;
}

fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Real value[])
{
    for (size_t k = 0; k < n; k++) {
        if (vr[k] != U) {
            return fmi2Error;
        }
        live(c)->u = value[k];
    }
    return fmi2OK;
}

fmi2Status fmi2SetInteger(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Integer value[])
{
    live(c)->gear = value[0];
    return n == 1 && vr[0] == GEAR ? fmi2OK : fmi2Error;
}

fmi2Status fmi2SetBoolean(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Boolean value[])
{
    live(c)->flag = value[0];
    return n == 1 && vr[0] == FLAG ? fmi2OK : fmi2Error;
}

fmi2Status fmi2SetString(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2String value[])
{
    strncpy(live(c)->manner, value[0], sizeof live(c)->manner - 1);
    return n == 1 && vr[0] == MANNER ? fmi2OK : fmi2Error;
}

fmi2Status fmi2GetRealStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Real *value)
{
    *value = live(c)->reached;
    return kind == fmi2LastSuccessfulTime ? fmi2OK : fmi2Discard;
}

fmi2Status fmi2GetBooleanStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Boolean *value)
{
    *value = live(c)->ended;
    return kind == fmi2Terminated ? fmi2OK : fmi2Discard;
}

fmi2Status fmi2CancelStep(fmi2Component c)
{
    live(c)->pending = 0;
    return fmi2OK;
}

fmi2Status fmi2Terminate(fmi2Component c)
{
    return live(c)->pending ? fmi2Error : fmi2OK;
}

fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *state)
{
    Instance *kept = *state ? *state : malloc(sizeof *kept);
    *kept = *live(c);
    *state = kept;
    return fmi2OK;
}

fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate state)
{
    *live(c) = *(Instance *)state;
    return fmi2OK;
}

fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *state)
{
    live(c);
    free(*state);
    *state = NULL;
    return fmi2OK;
}

const char *fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }
const char *fmi2GetVersion(void) { return fmi2Version; }
#define ACCEPTED(name, ...) fmi2Status name(fmi2Component c, ##__VA_ARGS__) { live(c); return fmi2OK; }
ACCEPTED(fmi2SetDebugLogging, fmi2Boolean on, size_t n, const fmi2String categories[])
ACCEPTED(fmi2SetupExperiment, fmi2Boolean td, fmi2Real t, fmi2Real start, fmi2Boolean sd, fmi2Real stop)
ACCEPTED(fmi2ExitInitializationMode)

/* Functions that the standard requires but many libraries lack. */
#ifndef SPARSE
#define REFUSED(name, ...) fmi2Status name(fmi2Component c, ##__VA_ARGS__) { return fmi2Error; }
REFUSED(fmi2GetInteger, const fmi2ValueReference vr[], size_t n, fmi2Integer v[])
REFUSED(fmi2GetBoolean, const fmi2ValueReference vr[], size_t n, fmi2Boolean v[])
REFUSED(fmi2GetString, const fmi2ValueReference vr[], size_t n, fmi2String v[])
REFUSED(fmi2SerializedFMUstateSize, fmi2FMUstate state, size_t *size)
REFUSED(fmi2SerializeFMUstate, fmi2FMUstate state, fmi2Byte bytes[], size_t size)
REFUSED(fmi2DeSerializeFMUstate, const fmi2Byte bytes[], size_t size, fmi2FMUstate *state)
REFUSED(fmi2GetDirectionalDerivative, const fmi2ValueReference u[], size_t n, const fmi2ValueReference k[], size_t m,
        const fmi2Real dk[], fmi2Real du[])
REFUSED(fmi2SetRealInputDerivatives, const fmi2ValueReference vr[], size_t n, const fmi2Integer o[], const fmi2Real v[])
REFUSED(fmi2GetRealOutputDerivatives, const fmi2ValueReference vr[], size_t n, const fmi2Integer o[], fmi2Real v[])
REFUSED(fmi2GetStatus, const fmi2StatusKind kind, fmi2Status *v)
REFUSED(fmi2GetIntegerStatus, const fmi2StatusKind kind, fmi2Integer *v)
REFUSED(fmi2GetStringStatus, const fmi2StatusKind kind, fmi2String *v)
#endif
