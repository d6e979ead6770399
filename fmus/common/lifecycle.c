/* The life of an instance from fmi2Instantiate to fmi2FreeInstance, except its steps. */
#include <stdlib.h>
#include <string.h>

#include "calls.h"
#include "elementary.h"
#include "wide.h"

const char *fmi2GetTypesPlatform(void)
{
    return fmi2TypesPlatform;
}

const char *fmi2GetVersion(void)
{
    return fmi2Version;
}

static void freed(Component *c)
{
    const fmi2CallbackFreeMemory release = c->release;
    if (c->work != NULL) {
        release(c->work);
    }
    if (c->name != NULL) {
        release(c->name);
    }
    release(c);
}

static Component *created(const fmi2CallbackFunctions *functions, const char *name)
{
    Component blank = {.logger = functions->logger, .environment = functions->componentEnvironment};
    const int own = functions->allocateMemory == NULL || functions->freeMemory == NULL;
    blank.allocate = own ? calloc : functions->allocateMemory;
    blank.release = own ? free : functions->freeMemory;
    Component *c = (Component *)allocated(&blank, sizeof *c);
    if (c == NULL) {
        return NULL;
    }
    *c = blank;
    c->name = (char *)allocated(c, strlen(name) + 1);
    c->work = allocated(c, model_work_size() + 1);
    if (c->name == NULL || c->work == NULL) {
        freed(c);
        return NULL;
    }
    memcpy(c->name, name, strlen(name) + 1);
    return c;
}

static const char *reason_not_to_instantiate(fmi2String name, fmi2Type type, fmi2String guid)
{
    if (name == NULL || name[0] == '\0') {
        return "the instance has no name";
    }
    if (type != fmi2CoSimulation && type != fmi2ModelExchange) {
        return "the type is neither co-simulation nor model exchange";
    }
    if (guid == NULL || strcmp(guid, MODEL_GUID) != 0) {
        return "the GUID of modelDescription.xml is not that of this binary, which is " MODEL_GUID;
    }
    return NULL;
}

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                              const fmi2CallbackFunctions *functions, fmi2Boolean visible, fmi2Boolean logging)
{
    const char *reason = reason_not_to_instantiate(name, type, guid);
    (void)resources; /* all data are compiled into the library */
    (void)visible;
    if (functions == NULL) {
        return NULL;
    }
    if (reason != NULL) {
        const Component unborn = {
            .name = (char *)(name == NULL ? "" : name),
            .logger = functions->logger,
            .environment = functions->componentEnvironment,
        };
        refused(&unborn, "fmi2Instantiate", reason);
        return NULL;
    }
    Component *c = created(functions, name);
    if (c != NULL) {
        c->logging = logging != fmi2False;
        c->categories = ~0;
        c->is_wide = can_be_wide();
        c->is_model_exchange = type == fmi2ModelExchange;
        c->tag = c->is_model_exchange ? ~STATE_TAG : STATE_TAG;
        start_over(&c->memory);
    }
    return c;
}

void fmi2FreeInstance(fmi2Component instance)
{
    if (instance != NULL) {
        freed((Component *)instance);
    }
}

fmi2Status fmi2SetupExperiment(fmi2Component instance, fmi2Boolean has_tolerance, fmi2Real tolerance, fmi2Real start,
                               fmi2Boolean has_stop, fmi2Real stop)
{
    Component *c = entered(instance, "fmi2SetupExperiment", INSTANTIATED);
    (void)has_tolerance; /* a step is exact, and derivatives are */
    (void)tolerance;
    if (c == NULL) {
        return fmi2Error;
    }
    if (!is_finite(start)) {
        return refused(c, "fmi2SetupExperiment", "the start time is not finite");
    }
    if (has_stop && !(is_finite(stop) && stop >= start)) {
        return refused(c, "fmi2SetupExperiment", "the stop time is before the start time, or not finite");
    }
    c->memory.time = start;
    c->memory.stop = has_stop ? stop : NO_LIMIT;
    return fmi2OK;
}

fmi2Status fmi2EnterInitializationMode(fmi2Component instance)
{
    Component *c = entered(instance, "fmi2EnterInitializationMode", INSTANTIATED);
    if (c == NULL) {
        return fmi2Error;
    }
    c->memory.phase = INITIALIZING;
    return fmi2OK;
}

fmi2Status fmi2ExitInitializationMode(fmi2Component instance)
{
    Component *c = entered(instance, "fmi2ExitInitializationMode", INITIALIZING);
    if (c == NULL || !started(c, "fmi2ExitInitializationMode")) {
        return fmi2Error;
    }
    c->memory.phase = c->is_model_exchange ? EVENT : STEPPING;
    logged(c, fmi2OK, "initialized");
    return fmi2OK;
}

fmi2Status fmi2Terminate(fmi2Component instance)
{
    Component *c = entered(instance, "fmi2Terminate", STEPPING | EXCHANGING);
    if (c == NULL) {
        return fmi2Error;
    }
    c->memory.phase = TERMINATED;
    return fmi2OK;
}

fmi2Status fmi2Reset(fmi2Component instance)
{
    Component *c = entered(instance, "fmi2Reset", ALIVE);
    if (c == NULL) {
        return fmi2Error;
    }
    start_over(&c->memory);
    return fmi2OK;
}
