/* FMI 3.0: the life of an instance, and messages to its host. */
#include <stdlib.h>
#include <string.h>

#include "fmi3_instance.h"

/* ---- Messages --------------------------------------------------------------------------------------------------------- */

/* Words of the core's messages that are others in FMI 3.0. The first that fits counts, so longer ones come first. */
static const char *const RENAMED[][2] = {
    {"fmi2SetReal", "fmi3SetFloat64"},
    {"fmi2GetRealOutputDerivatives", "fmi3GetOutputDerivatives"},
    {"fmi2GetReal", "fmi3GetFloat64"},
    {"fmi2SetupExperiment", "fmi3EnterInitializationMode"},
    {"fmi2GetFMUstate", "fmi3GetFMUState"},
    {"fmi2SetFMUstate", "fmi3SetFMUState"},
    {"fmi2FreeFMUstate", "fmi3FreeFMUState"},
    {"fmi2SerializedFMUstateSize", "fmi3SerializedFMUStateSize"},
    {"fmi2SerializeFMUstate", "fmi3SerializeFMUState"},
    {"fmi2DeSerializeFMUstate", "fmi3DeserializeFMUState"},
    {"fmi2NewDiscreteStates", "fmi3UpdateDiscreteStates"},
    {"fmi2GetDerivatives", "fmi3GetContinuousStateDerivatives"},
    {"fmi2", "fmi3"},
    {"a Real variable", "a Float64 variable"},
};
enum { RENAMED_COUNT = sizeof RENAMED / sizeof RENAMED[0] };

/* Appends the word of FMI 3.0 for the one that a text begins with, or one letter; returns the rest of the text. */
static const char *say_word(Message *message, const char *text)
{
    const char letter[2] = {*text, '\0'};
    for (int k = 0; k < RENAMED_COUNT; k++) {
        const size_t length = strlen(RENAMED[k][0]);
        if (strncmp(text, RENAMED[k][0], length) == 0) {
            say(message, RENAMED[k][1]);
            return text + length;
        }
    }
    say(message, letter);
    return text + 1;
}

/* Errors are always logged, other messages only in categories that are on (FMI 3.0.2, 2.3.1); the first one contains all. */
static int is_on(const Component *core, fmi2Status status)
{
    return status >= fmi2Error || (core->logging && core->categories & (1 << (int)status | 1));
}

/* The logger of the core: passes messages on, with the names of FMI 3.0. */
static void pass_on(fmi2ComponentEnvironment environment, fmi2String name, fmi2Status status, fmi2String category,
                    fmi2String text, ...)
{
    const Instance *instance = (const Instance *)environment;
    Message message = {.length = 0};
    (void)name;
    if (instance->core != NULL && !is_on(instance->core, status)) {
        return;
    }
    while (*text != '\0') {
        text = say_word(&message, text);
    }
    instance->log(instance->environment, status3(status), category, message.text);
}

fmi3Status refused3(fmi3Instance instance, const char *function, const char *reason)
{
    return instance == NULL ? fmi3Error : status3(refused(((const Instance *)instance)->core, function, reason));
}

Component *core_of(fmi3Instance instance, const char *function)
{
    const Instance *own = (const Instance *)instance;
    if (own != NULL && own->is_updating) {
        refused3(instance, function, "is not allowed during an intermediate update, which sets inputs");
        return NULL;
    }
    return own == NULL ? NULL : own->core;
}

/* ---- Creation --------------------------------------------------------------------------------------------------------- */

const char *fmi3GetVersion(void)
{
    return fmi3Version;
}

typedef struct {
    const char *function;
    fmi3String name, token;
    fmi3Boolean logging;
    fmi3InstanceEnvironment environment;
    fmi3LogMessageCallback log;
} Request;

static fmi3Instance refuse_to_instantiate(const Request *request, const char *reason)
{
    Message message = {.length = 0};
    say(&message, request->function);
    say(&message, ": ");
    say(&message, reason);
    if (request->log != NULL) {
        request->log(request->environment, fmi3Error, "logStatusError", message.text);
    }
    return NULL;
}

static Instance *instantiated(const Request *request, fmi2Type type)
{
    if (request->name == NULL || request->name[0] == '\0') {
        return (Instance *)refuse_to_instantiate(request, "the instance has no name");
    }
    if (request->token == NULL || strcmp(request->token, MODEL_GUID) != 0) {
        return (Instance *)refuse_to_instantiate(
            request, "the instantiationToken of modelDescription.xml is not that of this binary, which is " MODEL_GUID);
    }
    Instance *instance = (Instance *)calloc(1, sizeof *instance);
    if (instance == NULL) {
        return NULL;
    }
    const fmi2CallbackFunctions callbacks = {
        .logger = request->log == NULL ? NULL : pass_on,
        .componentEnvironment = instance,
    };
    instance->environment = request->environment;
    instance->log = request->log;
    instance->core =
        (Component *)fmi2Instantiate(request->name, type, MODEL_GUID, NULL, &callbacks, fmi2False, request->logging);
    if (instance->core == NULL) {
        free(instance);
        return NULL;
    }
    return instance;
}

fmi3Instance fmi3InstantiateModelExchange(fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
                                          fmi3Boolean logging, fmi3InstanceEnvironment environment,
                                          fmi3LogMessageCallback log)
{
    const Request request = {"fmi3InstantiateModelExchange", name, token, logging, environment, log};
    (void)resources; /* all data are compiled into the library */
    (void)visible;
    return instantiated(&request, fmi2ModelExchange);
}

/* Only inputs can be set in an intermediate update, and nothing can be read there: outputs are known at the end of a step. */
static int are_intermediate(const fmi3ValueReference required[], size_t n)
{
    if (n > 0 && required == NULL) {
        return 0;
    }
    for (size_t k = 0; k < n; k++) {
        if (place_of_input(required[k]) < 0) {
            return 0;
        }
    }
    return 1;
}

fmi3Instance fmi3InstantiateCoSimulation(fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
                                         fmi3Boolean logging, fmi3Boolean event_mode, fmi3Boolean early_return,
                                         const fmi3ValueReference required[], size_t n_required,
                                         fmi3InstanceEnvironment environment, fmi3LogMessageCallback log,
                                         fmi3IntermediateUpdateCallback update)
{
    const Request request = {"fmi3InstantiateCoSimulation", name, token, logging, environment, log};
    (void)resources;
    (void)visible;
    (void)early_return; /* no step ever returns early */
    if (event_mode) {
        return refuse_to_instantiate(&request, "event mode is not offered (hasEventMode is false)");
    }
    if (!are_intermediate(required, n_required)) {
        return refuse_to_instantiate(
            &request, "a required intermediate variable is not an input: only those have intermediateUpdate=\"true\"");
    }
    Instance *instance = instantiated(&request, fmi2CoSimulation);
    if (instance != NULL) {
        instance->update = update;
    }
    return instance;
}

fmi3Instance fmi3InstantiateScheduledExecution(fmi3String name, fmi3String token, fmi3String resources,
                                               fmi3Boolean visible, fmi3Boolean logging,
                                               fmi3InstanceEnvironment environment, fmi3LogMessageCallback log,
                                               fmi3ClockUpdateCallback clock, fmi3LockPreemptionCallback lock,
                                               fmi3UnlockPreemptionCallback unlock)
{
    const Request request = {"fmi3InstantiateScheduledExecution", name, token, logging, environment, log};
    (void)resources;
    (void)visible;
    (void)clock;
    (void)lock;
    (void)unlock;
    return refuse_to_instantiate(&request, "scheduled execution is not offered: use co-simulation or model exchange");
}

void fmi3FreeInstance(fmi3Instance instance)
{
    if (instance != NULL) {
        fmi2FreeInstance(((const Instance *)instance)->core);
        free(instance);
    }
}

/* ---- Phases ----------------------------------------------------------------------------------------------------------- */

/* Unlike in FMI 2.0, a call turns its categories on or off, and leaves the others as they are. */
fmi3Status fmi3SetDebugLogging(fmi3Instance instance, fmi3Boolean on, size_t n, const fmi3String categories[])
{
    Component *core = core_of(instance, "fmi3SetDebugLogging");
    const int before = core != NULL && core->logging ? core->categories : 0;
    const fmi2Status status = fmi2SetDebugLogging(core, fmi2True, n, categories);
    if (status == fmi2OK) {
        core->categories = on ? before | core->categories : before & ~core->categories;
    }
    return status3(status);
}

fmi3Status fmi3EnterInitializationMode(fmi3Instance instance, fmi3Boolean has_tolerance, fmi3Float64 tolerance,
                                       fmi3Float64 start, fmi3Boolean has_stop, fmi3Float64 stop)
{
    Component *core = core_of(instance, "fmi3EnterInitializationMode");
    const fmi2Status status = fmi2SetupExperiment(core, has_tolerance, tolerance, start, has_stop, stop);
    return status3(status == fmi2OK ? fmi2EnterInitializationMode(core) : status);
}

fmi3Status fmi3ExitInitializationMode(fmi3Instance instance)
{
    return status3(fmi2ExitInitializationMode(core_of(instance, "fmi3ExitInitializationMode")));
}

fmi3Status fmi3Terminate(fmi3Instance instance)
{
    return status3(fmi2Terminate(core_of(instance, "fmi3Terminate")));
}

fmi3Status fmi3Reset(fmi3Instance instance)
{
    return status3(fmi2Reset(core_of(instance, "fmi3Reset")));
}

fmi3Status fmi3EnterConfigurationMode(fmi3Instance instance)
{
    return refused3(instance, "fmi3EnterConfigurationMode", "this FMU has no structural parameters");
}

fmi3Status fmi3ExitConfigurationMode(fmi3Instance instance)
{
    return refused3(instance, "fmi3ExitConfigurationMode", "this FMU has no structural parameters");
}
