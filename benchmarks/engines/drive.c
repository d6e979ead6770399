/* An FMU without inputs that plays back a table: the drive for engines that take signals from FMUs only.
 *
 * resources/drive.bin: the number of rows N as a double, N times [s], then N rows of values; linear between them.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "fmi2Functions.h"

#define CHANNELS 7

typedef struct {
    double *times, *rows;
    size_t count, at;
    double now[CHANNELS];
} Instance;

static void path_of(const char *uri, char *path, size_t room)
{
    const char *from = strncmp(uri, "file:///", 8) == 0 ? uri + 7 : strncmp(uri, "file:/", 6) == 0 ? uri + 5 : uri;
    size_t k = 0;
    for (; *from && k + 1 < room; from++) {
        unsigned code;
        if (*from == '%' && sscanf(from + 1, "%2x", &code) == 1) {
            path[k++] = (char)code;
            from += 2;
        } else {
            path[k++] = *from;
        }
    }
    path[k] = 0;
}

static int load(Instance *i, const char *path)
{
    double count = 0.0;
    FILE *file = fopen(path, "rb");
    if (file == NULL) {
        return 0;
    }
    int whole = fread(&count, sizeof count, 1, file) == 1;
    i->count = (size_t)count;
    i->times = malloc((i->count + 1) * sizeof(double));
    i->rows = malloc((i->count + 1) * CHANNELS * sizeof(double));
    whole = whole && i->times != NULL && i->rows != NULL;
    whole = whole && fread(i->times, sizeof(double), i->count, file) == i->count;
    whole = whole && fread(i->rows, CHANNELS * sizeof(double), i->count, file) == i->count;
    fclose(file);
    return whole && i->count > 1;
}

static void play(Instance *i, double time)
{
    while (i->at > 0 && time < i->times[i->at]) {
        i->at--;
    }
    while (i->at + 2 < i->count && time >= i->times[i->at + 1]) {
        i->at++;
    }
    const double share = (time - i->times[i->at]) / (i->times[i->at + 1] - i->times[i->at]);
    const double *row = i->rows + CHANNELS * i->at;
    for (int k = 0; k < CHANNELS; k++) {
        i->now[k] = row[k] + share * (row[k + CHANNELS] - row[k]);
    }
}

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                              const fmi2CallbackFunctions *callbacks, fmi2Boolean visible, fmi2Boolean logging)
{
    (void)name, (void)type, (void)guid, (void)callbacks, (void)visible, (void)logging;
    char path[4096];
    Instance *i = calloc(1, sizeof *i);
    if (i == NULL || resources == NULL) {
        return NULL;
    }
    path_of(resources, path, sizeof path - 16);
    strcat(path, "/drive.bin");
    if (!load(i, path)) {
        return NULL;
    }
    play(i, 0.0);
    return i;
}

void fmi2FreeInstance(fmi2Component c)
{
    Instance *i = c;
    free(i->times);
    free(i->rows);
    free(i);
}

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real time, fmi2Real step, fmi2Boolean final)
{
    (void)final;
    play(c, time + step);
    return fmi2OK;
}

fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Real value[])
{
    const Instance *i = c;
    for (size_t k = 0; k < n; k++) {
        if (vr[k] >= CHANNELS) {
            return fmi2Error;
        }
        value[k] = i->now[vr[k]];
    }
    return fmi2OK;
}

fmi2Status fmi2Reset(fmi2Component c)
{
    play(c, 0.0);
    return fmi2OK;
}

const char *fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }
const char *fmi2GetVersion(void) { return fmi2Version; }

/* Nothing else is needed, but some hosts load every function. */
#pragma GCC diagnostic ignored "-Wunused-parameter"
typedef fmi2Component C;
typedef const fmi2ValueReference *VR;
typedef fmi2FMUstate State;
fmi2Status fmi2SetDebugLogging(C c, fmi2Boolean on, size_t n, const fmi2String names[]) { return fmi2OK; }
fmi2Status fmi2SetupExperiment(C c, fmi2Boolean t, fmi2Real tolerance, fmi2Real start, fmi2Boolean s, fmi2Real stop)
{
    return fmi2OK;
}
fmi2Status fmi2EnterInitializationMode(C c) { return fmi2OK; }
fmi2Status fmi2ExitInitializationMode(C c) { return fmi2OK; }
fmi2Status fmi2Terminate(C c) { return fmi2OK; }
fmi2Status fmi2GetInteger(C c, VR vr, size_t n, fmi2Integer value[]) { return n ? fmi2Error : fmi2OK; }
fmi2Status fmi2GetBoolean(C c, VR vr, size_t n, fmi2Boolean value[]) { return n ? fmi2Error : fmi2OK; }
fmi2Status fmi2GetString(C c, VR vr, size_t n, fmi2String value[]) { return n ? fmi2Error : fmi2OK; }
fmi2Status fmi2SetReal(C c, VR vr, size_t n, const fmi2Real value[]) { return n ? fmi2Error : fmi2OK; }
fmi2Status fmi2SetInteger(C c, VR vr, size_t n, const fmi2Integer value[]) { return n ? fmi2Error : fmi2OK; }
fmi2Status fmi2SetBoolean(C c, VR vr, size_t n, const fmi2Boolean value[]) { return n ? fmi2Error : fmi2OK; }
fmi2Status fmi2SetString(C c, VR vr, size_t n, const fmi2String value[]) { return n ? fmi2Error : fmi2OK; }
fmi2Status fmi2GetFMUstate(C c, State *state) { return fmi2Error; }
fmi2Status fmi2SetFMUstate(C c, State state) { return fmi2Error; }
fmi2Status fmi2FreeFMUstate(C c, State *state) { return fmi2Error; }
fmi2Status fmi2SerializedFMUstateSize(C c, State state, size_t *size) { return fmi2Error; }
fmi2Status fmi2SerializeFMUstate(C c, State state, fmi2Byte bytes[], size_t size) { return fmi2Error; }
fmi2Status fmi2DeSerializeFMUstate(C c, const fmi2Byte bytes[], size_t size, State *state) { return fmi2Error; }
fmi2Status fmi2GetDirectionalDerivative(C c, VR of, size_t n, VR by, size_t m, const fmi2Real d[], fmi2Real found[])
{
    return fmi2Error;
}
fmi2Status fmi2SetRealInputDerivatives(C c, VR vr, size_t n, const fmi2Integer order[], const fmi2Real value[])
{
    return fmi2Error;
}
fmi2Status fmi2GetRealOutputDerivatives(C c, VR vr, size_t n, const fmi2Integer order[], fmi2Real value[])
{
    return fmi2Error;
}
fmi2Status fmi2CancelStep(C c) { return fmi2Error; }
fmi2Status fmi2GetStatus(C c, const fmi2StatusKind kind, fmi2Status *value) { return fmi2Discard; }
fmi2Status fmi2GetRealStatus(C c, const fmi2StatusKind kind, fmi2Real *value) { return fmi2Discard; }
fmi2Status fmi2GetIntegerStatus(C c, const fmi2StatusKind kind, fmi2Integer *value) { return fmi2Discard; }
fmi2Status fmi2GetBooleanStatus(C c, const fmi2StatusKind kind, fmi2Boolean *value) { return fmi2Discard; }
fmi2Status fmi2GetStringStatus(C c, const fmi2StatusKind kind, fmi2String *value) { return fmi2Discard; }
