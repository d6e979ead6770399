/* Variables of every type: outputs that change with time, and inputs that a Real output encodes.

   count = floor(250 t), is_odd of it, mode = 1 + count modulo 3, wave = sin(20 t)
   seen  = integer + 10 boolean + 100 item + 1000 real, with the values during the last step */
#include <math.h>
#include <stdlib.h>

#include "fmi2Functions.h"

enum { COUNT = 1, MODE = 2, IS_ODD = 1, WAVE = 1, SEEN = 2, INTEGER = 10, ITEM = 11, BOOLEAN = 10, REAL = 10 };

typedef struct {
    double time, real, seen;
    int integer, item, boolean;
} Instance;

static int count(const Instance *i) { return (int)floor(250.0 * i->time + 1e-6); }

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                              const fmi2CallbackFunctions *callbacks, fmi2Boolean visible, fmi2Boolean logging)
{
    Instance *i = calloc(1, sizeof *i);
    i->item = 1;
    return i;
}

void fmi2FreeInstance(fmi2Component c) { free(c); }

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real time, fmi2Real step, fmi2Boolean final)
{
    Instance *i = c;
    i->time = time + step;
    i->seen = i->integer + 10.0 * i->boolean + 100.0 * i->item + 1000.0 * i->real;
    return fmi2OK;
}

fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Real value[])
{
    const Instance *i = c;
    for (size_t k = 0; k < n; k++) {
        value[k] = vr[k] == WAVE ? sin(20.0 * i->time) : vr[k] == SEEN ? i->seen : i->real;
    }
    return fmi2OK;
}

fmi2Status fmi2GetInteger(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Integer value[])
{
    const Instance *i = c;
    for (size_t k = 0; k < n; k++) {
        value[k] = vr[k] == COUNT ? count(i) : vr[k] == MODE ? 1 + count(i) % 3 : vr[k] == ITEM ? i->item : i->integer;
    }
    return fmi2OK;
}

fmi2Status fmi2GetBoolean(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Boolean value[])
{
    const Instance *i = c;
    for (size_t k = 0; k < n; k++) {
        value[k] = vr[k] == IS_ODD ? count(i) % 2 : i->boolean;
    }
    return fmi2OK;
}

fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Real value[])
{
    ((Instance *)c)->real = value[n - 1];
    return fmi2OK;
}

fmi2Status fmi2SetInteger(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Integer value[])
{
    for (size_t k = 0; k < n; k++) {
        *(vr[k] == ITEM ? &((Instance *)c)->item : &((Instance *)c)->integer) = value[k];
    }
    return fmi2OK;
}

fmi2Status fmi2SetBoolean(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Boolean value[])
{
    ((Instance *)c)->boolean = value[n - 1];
    return value[n - 1] == 0 || value[n - 1] == 1 ? fmi2OK : fmi2Error;
}

fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *state)
{
    Instance *kept = *state ? *state : malloc(sizeof *kept);
    *kept = *(Instance *)c;
    *state = kept;
    return fmi2OK;
}

fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate state)
{
    *(Instance *)c = *(Instance *)state;
    return fmi2OK;
}

fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *state)
{
    free(*state);
    *state = NULL;
    return fmi2OK;
}

#include "accepted_calls.h"
