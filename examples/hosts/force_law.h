/* A shock FMU (FMI 2.0 co-simulation) as a force law for your integrator: one header, C99 or C++, no other dependency.

   It loads the library of an unpacked .fmu, or calls FMU sources that are linked into the program, and offers three loops.
   Errors below: seven-DOF car, four shocks, RK4, 10 s of track; worst corner, % of the standard deviation of the shock
   velocity at steps of 4 / 2 / 1 ms (docs/how_to/hosts.md). Costs: one shock, LPNL2.

   C  force_law_force, force_law_accept, force_law_jacobian                            0.65 / 0.13 / 0.04 %, 0.06 us
      The force at any trial point: from the last accepted point, along a ramp of the inputs, without side effects.
      Explicit and implicit integrators, rejected steps, any step size. Needs canGetAndSetFMUstate.
   B  force_law_extrapolate                                                            3.5 / 0.93 / 0.23 %, 0.09 us
      For hosts that cannot repeat: steps up to now along a ramp, then holds 1.5 F - 0.5 F_old over the next step.
      Second order; stable while c h / m is below about 0.5 (damping, step, mass of the wheel).
   A  force_law_hold                                                                   6.0 / 2.2 / 0.84 %, 0.07 us
      Steps over the next step with the velocity of now, and holds the force at its end. First order, always possible.

   Use, for each corner (all functions return 0, or -1 with the reason in law.error):

       ForceLaw law;
       force_law_open(&law, "unpacked/shock", "velocity", "displacement", "force");
       force_law_parameter(&law, "compression_scale", 1.1);                            optional
       force_law_start(&law, t, velocity, displacement, &force);                       in equilibrium
       force_law_force(&law, t, velocity, displacement, &force);                       in every stage and iteration
       force_law_accept(&law, t, velocity, displacement, &force);                      after every accepted step
       force_law_close(&law);

   Velocity [m/s], displacement [m] and force [N] are positive in compression. For an FMU with other units or signs, set
   law.scale[0..2] after opening: FMU value = scale * SI value, for velocity, displacement, force. A shock without a
   displacement input is opened with NULL for its name. A ForceLaw must not be moved in memory while it is open. No
   function but open, start and close allocates memory. Link with -ldl on Linux.

   Linked sources: compile the FMU's sources with -DFMI2_FUNCTION_PREFIX=shock_ and this header with
   -DFORCE_LAW_PREFIX=shock_; then force_law_link takes the place of force_law_open. */
#ifndef FORCE_LAW_H
#define FORCE_LAW_H

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#ifdef _WIN32
#include <windows.h>
#elif !defined(FORCE_LAW_PREFIX)
#include <dlfcn.h>
#endif

#ifdef __cplusplus
extern "C" {
#endif

/* ---- FMI 2.0, as far as it is needed --------------------------------------------------------------------------------- */

typedef void (*ForceLawLogger)(void *environment, const char *instance, int status, const char *category, const char *text,
                               ...);

typedef struct {
    ForceLawLogger logger;
    void *(*allocate)(size_t count, size_t size);
    void (*release)(void *memory);
    void (*finished)(void *environment, int status);
    void *environment;
} ForceLawCallbacks;

/* Each function: type, member of ForceLawCalls, name, arguments. */
#define FORCE_LAW_FUNCTIONS(X)                                                                                                 \
    X(void *, instantiate, fmi2Instantiate, (const char *name, int kind, const char *guid, const char *resources,              \
                                             const ForceLawCallbacks *callbacks, int visible, int logging))                    \
    X(void, free_instance, fmi2FreeInstance, (void *))                                                                         \
    X(int, setup, fmi2SetupExperiment, (void *, int has_tolerance, double tolerance, double start, int has_stop, double stop)) \
    X(int, enter, fmi2EnterInitializationMode, (void *))                                                                       \
    X(int, leave, fmi2ExitInitializationMode, (void *))                                                                        \
    X(int, terminate, fmi2Terminate, (void *))                                                                                 \
    X(int, reset, fmi2Reset, (void *))                                                                                         \
    X(int, set_real, fmi2SetReal, (void *, const unsigned *references, size_t count, const double *values))                    \
    X(int, get_real, fmi2GetReal, (void *, const unsigned *references, size_t count, double *values))                          \
    X(int, set_slopes, fmi2SetRealInputDerivatives, (void *, const unsigned *references, size_t count, const int *orders,      \
                                                     const double *slopes))                                                    \
    X(int, step, fmi2DoStep, (void *, double time, double size, int final))                                                    \
    X(int, get_state, fmi2GetFMUstate, (void *, void **state))                                                                 \
    X(int, set_state, fmi2SetFMUstate, (void *, void *state))                                                                  \
    X(int, free_state, fmi2FreeFMUstate, (void *, void **state))
#define FORCE_LAW_MEMBER(type, member, name, arguments) type(*member) arguments;

typedef struct {
    FORCE_LAW_FUNCTIONS(FORCE_LAW_MEMBER)
} ForceLawCalls;

/* ---- The force law --------------------------------------------------------------------------------------------------- */

typedef struct {
    double scale[3];                             /* FMU value per SI value: velocity, displacement, force */
    char error[512];                             /* reason of the last failure */
    double time, velocity, displacement, force;  /* last accepted point [s], [m/s], [m], [N] */
    /* The rest is internal. */
    double trial[3], rate;
    int width, ramps, states, has_trial, started;
    unsigned references[3], parameters[32];
    double parameter_values[32];
    int parameter_count;
    void *library, *instance, *state;
    char *description, message[256];
    ForceLawCalls calls;
    ForceLawCallbacks callbacks;
} ForceLaw;

/* Largest time difference that counts as none, and the step over which the inputs jump if no time passes [s]. */
#define FORCE_LAW_SHORTEST 1e-9
/* Without input derivatives, the inputs have their end values over this last part of a step. */
#define FORCE_LAW_END_PART (1.0 / 1024.0)
/* Change of an input for the Jacobian [m/s], [m]. */
#define FORCE_LAW_DIFFERENCE 1e-6

static inline int force_law_fails(ForceLaw *law, const char *format, ...)
{
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(law->error, sizeof law->error, format, arguments);
    va_end(arguments);
    return -1;
}

static inline void force_law_log(void *environment, const char *instance, int status, const char *category, const char *text,
                                 ...)
{
    ForceLaw *law = (ForceLaw *)environment;
    (void)instance, (void)category;
    if (law != NULL && status > 0) {
        va_list arguments;
        va_start(arguments, text);
        vsnprintf(law->message, sizeof law->message, text, arguments);
        va_end(arguments);
    }
}

/* Returns 0 if a call succeeded, else -1 with the FMU's own message. */
static inline int force_law_checked(ForceLaw *law, int status, const char *call)
{
    static const char *const names[] = {"fmi2OK", "fmi2Warning", "fmi2Discard", "fmi2Error", "fmi2Fatal", "fmi2Pending"};
    if (status == 0 || status == 1) {
        return 0;
    }
    return force_law_fails(law, "%s returned %s after %.9g s; the FMU says: %s", call,
                           status > 1 && status < 6 ? names[status] : "an unknown status", law->time,
                           law->message[0] ? law->message : "nothing");
}

/* Ends a function with -1 if a call in it fails. */
#define FORCE_LAW_TRY(call) do { if ((call) != 0) { return -1; } } while (0)

/* ---- Opening --------------------------------------------------------------------------------------------------------- */

/* Copies the value of an attribute of the element that begins at `element`; returns 0 if there is one. */
static inline int force_law_attribute(const char *element, const char *name, char *value, size_t size)
{
    const char *end = strchr(element, '>'), *at = element;
    const size_t length = strlen(name);
    while (end != NULL && (at = strstr(at, name)) != NULL && at < end) {
        const char before = at == element ? ' ' : at[-1];
        if ((before == ' ' || before == '\t' || before == '\n' || before == '\r') && at[length] == '=' && at[length + 1] != 0) {
            const char quote = at[length + 1], *first = at + length + 2, *last = strchr(first, quote);
            const size_t count = last == NULL ? size : (size_t)(last - first);
            if (count >= size) {
                return -1;
            }
            memcpy(value, first, count);
            value[count] = 0;
            return 0;
        }
        at += length;
    }
    return -1;
}

static inline int force_law_flag(const char *element, const char *name)
{
    char value[8] = "";
    return element != NULL && force_law_attribute(element, name, value, sizeof value) == 0 && strcmp(value, "true") == 0;
}

/* Finds the value reference of a variable. */
static inline int force_law_variable(ForceLaw *law, const char *name, unsigned *reference)
{
    const char *element = law->description;
    char value[256];
    while (element != NULL && (element = strstr(element, "<ScalarVariable")) != NULL) {
        if (force_law_attribute(element, "name", value, sizeof value) == 0 && strcmp(value, name) == 0 &&
            force_law_attribute(element, "valueReference", value, sizeof value) == 0) {
            *reference = (unsigned)strtoul(value, NULL, 10);
            return 0;
        }
        element += strlen("<ScalarVariable");
    }
    return force_law_fails(law, "the FMU has no variable %s; give the name as in its modelDescription.xml", name);
}

static inline int force_law_instantiate(ForceLaw *law, const char *guid, const char *resources)
{
    const ForceLawCallbacks callbacks = {force_law_log, calloc, free, NULL, law};
    law->callbacks = callbacks;
    law->instance = law->calls.instantiate("shock", 1, guid, resources, &law->callbacks, 0, 1);
    if (law->instance == NULL) {
        return force_law_fails(law, "fmi2Instantiate failed; the FMU says: %s", law->message[0] ? law->message : "nothing");
    }
    return 0;
}

static inline void force_law_clear(ForceLaw *law)
{
    memset(law, 0, sizeof *law);
    law->scale[0] = law->scale[1] = law->scale[2] = 1.0;
}

#ifdef FORCE_LAW_PREFIX
#define FORCE_LAW_JOIN(a, b) a##b
#define FORCE_LAW_NAME(prefix, name) FORCE_LAW_JOIN(prefix, name)
#define FORCE_LAW_LINKED(name) FORCE_LAW_NAME(FORCE_LAW_PREFIX, name)

#define FORCE_LAW_DECLARATION(type, member, name, arguments) type FORCE_LAW_LINKED(name) arguments;
#define FORCE_LAW_ENTRY(type, member, name, arguments) FORCE_LAW_LINKED(name),
FORCE_LAW_FUNCTIONS(FORCE_LAW_DECLARATION)

/* Uses linked sources of an FMU with input derivatives and states. The GUID and the value references of velocity,
   displacement and force are in its modelDescription.xml. */
static inline int force_law_link(ForceLaw *law, const char *guid, const unsigned references[3])
{
    const ForceLawCalls calls = {FORCE_LAW_FUNCTIONS(FORCE_LAW_ENTRY)};
    force_law_clear(law);
    law->calls = calls;
    memcpy(law->references, references, sizeof law->references);
    law->width = 2;
    law->ramps = law->states = 1;
    return force_law_instantiate(law, guid, NULL);
}

#else

/* Folder and suffix of the library for this platform. */
#if defined(_WIN64)
#define FORCE_LAW_LIBRARY "%s/binaries/win64/%s.dll"
#elif defined(_WIN32)
#define FORCE_LAW_LIBRARY "%s/binaries/win32/%s.dll"
#elif defined(__APPLE__)
#define FORCE_LAW_LIBRARY "%s/binaries/darwin64/%s.dylib"
#elif defined(__aarch64__)
#define FORCE_LAW_LIBRARY "%s/binaries/aarch64-linux/%s.so"
#else
#define FORCE_LAW_LIBRARY "%s/binaries/linux64/%s.so"
#endif

/* Reads modelDescription.xml without its comments. */
static inline int force_law_read(ForceLaw *law, const char *folder)
{
    char path[4096], *comment;
    snprintf(path, sizeof path, "%s/modelDescription.xml", folder);
    FILE *file = fopen(path, "rb");
    if (file == NULL) {
        return force_law_fails(law, "%s cannot be read; unpack the .fmu, which is a zip archive, into that folder", path);
    }
    const long size = fseek(file, 0, SEEK_END) == 0 ? ftell(file) : -1;
    rewind(file);
    law->description = size > 0 ? (char *)calloc((size_t)size + 1, 1) : NULL;
    if (law->description == NULL || fread(law->description, 1, (size_t)size, file) != (size_t)size) {
        fclose(file);
        return force_law_fails(law, "%s cannot be read completely", path);
    }
    fclose(file);
    while ((comment = strstr(law->description, "<!--")) != NULL) {
        const char *end = strstr(comment, "-->"), *rest = end == NULL ? comment + strlen(comment) : end + 3;
        memmove(comment, rest, strlen(rest) + 1);
    }
    return 0;
}

static inline void *force_law_symbol(ForceLaw *law, const char *identifier, const char *name)
{
    char prefixed[512];
    void *found = NULL;
    snprintf(prefixed, sizeof prefixed, "%s_%s", identifier, name);
#ifdef _WIN32
    FARPROC address = GetProcAddress((HMODULE)law->library, name);
    address = address != NULL ? address : GetProcAddress((HMODULE)law->library, prefixed);
    memcpy(&found, &address, sizeof found);
#else
    found = dlsym(law->library, name);
    found = found != NULL ? found : dlsym(law->library, prefixed);
#endif
    return found;
}

#define FORCE_LAW_TEXT(type, member, name, arguments) #name,

static inline int force_law_load(ForceLaw *law, const char *folder, const char *identifier)
{
    static const char *const names[] = {FORCE_LAW_FUNCTIONS(FORCE_LAW_TEXT)};
    enum { NEEDED = 11, ALL = 14, RESET = 6, SLOPES = 9 };
    char path[4096];
    snprintf(path, sizeof path, FORCE_LAW_LIBRARY, folder, identifier);
#ifdef _WIN32
    law->library = (void *)LoadLibraryA(path);
    if (law->library == NULL) {
        return force_law_fails(law, "%s cannot be loaded (error %lu)", path, (unsigned long)GetLastError());
    }
#else
    law->library = dlopen(path, RTLD_NOW | RTLD_LOCAL);
    if (law->library == NULL) {
        return force_law_fails(law, "%s cannot be loaded: %s", path, dlerror());
    }
#endif
    for (int k = 0; k < ALL; k++) {
        void *found = force_law_symbol(law, identifier, names[k]);
        if (found == NULL && k != RESET && (k == SLOPES ? law->ramps : k < NEEDED || law->states)) {
            return force_law_fails(law, "%s has no function %s", path, names[k]);
        }
        memcpy((char *)&law->calls + (size_t)k * sizeof found, &found, sizeof found);
    }
    return 0;
}

/* Opens an FMU that is unpacked into a folder; names are those of its variables, `displacement` may be NULL. */
static inline int force_law_open(ForceLaw *law, const char *folder, const char *velocity, const char *displacement,
                                 const char *force)
{
    char identifier[256] = "", guid[256] = "", resources[4200];
    force_law_clear(law);
    FORCE_LAW_TRY(force_law_read(law, folder));
    const char *root = strstr(law->description, "<fmiModelDescription");
    const char *kind = strstr(law->description, "<CoSimulation");
    if (root == NULL || kind == NULL || force_law_attribute(root, "guid", guid, sizeof guid) != 0 ||
        force_law_attribute(kind, "modelIdentifier", identifier, sizeof identifier) != 0) {
        return force_law_fails(law, "%s is not an FMI 2.0 FMU for co-simulation; export it again as such", folder);
    }
    law->ramps = force_law_flag(kind, "canInterpolateInputs");
    law->states = force_law_flag(kind, "canGetAndSetFMUstate");
    law->width = displacement == NULL ? 1 : 2;
    FORCE_LAW_TRY(force_law_variable(law, velocity, &law->references[0]));
    FORCE_LAW_TRY(displacement == NULL ? 0 : force_law_variable(law, displacement, &law->references[1]));
    FORCE_LAW_TRY(force_law_variable(law, force, &law->references[2]));
    FORCE_LAW_TRY(force_law_load(law, folder, identifier));
    snprintf(resources, sizeof resources, "file://%s%s/resources", folder[0] == '/' ? "" : "/", folder);
    return force_law_instantiate(law, guid, resources);
}

/* Sets a Real parameter by name, between open and start; it is kept by later starts. */
static inline int force_law_parameter(ForceLaw *law, const char *name, double value)
{
    enum { MOST = sizeof law->parameters / sizeof *law->parameters };
    unsigned reference;
    FORCE_LAW_TRY(force_law_variable(law, name, &reference));
    if (law->parameter_count == MOST) {
        return force_law_fails(law, "more than %d parameters are set; build the FMU with these values", (int)MOST);
    }
    law->parameters[law->parameter_count] = reference;
    law->parameter_values[law->parameter_count++] = value;
    return force_law_checked(law, law->calls.set_real(law->instance, &reference, 1, &value), name);
}

#endif

/* Frees everything; the law may be opened again. */
static inline void force_law_close(ForceLaw *law)
{
    if (law->state != NULL) {
        law->calls.free_state(law->instance, &law->state);
    }
    if (law->instance != NULL) {
        if (law->started) {
            law->calls.terminate(law->instance);
        }
        law->calls.free_instance(law->instance);
    }
    free(law->description);
    if (law->library != NULL) {
#ifdef _WIN32
        FreeLibrary((HMODULE)law->library);
#elif !defined(FORCE_LAW_PREFIX)
        dlclose(law->library);
#endif
    }
    law->description = NULL;
    law->instance = law->library = law->state = NULL;
    law->started = 0;
}

/* ---- One step along a ramp ------------------------------------------------------------------------------------------- */

/* Sets the inputs to the point that lies this share of the way from the accepted to the trial point. */
static inline int force_law_set(ForceLaw *law, double share)
{
    const double values[2] = {law->scale[0] * ((1.0 - share) * law->velocity + share * law->trial[1]),
                              law->scale[1] * ((1.0 - share) * law->displacement + share * law->trial[2])};
    return force_law_checked(law, law->calls.set_real(law->instance, law->references, (size_t)law->width, values),
                             "fmi2SetReal");
}

static inline int force_law_held(ForceLaw *law, double share, double time, double h)
{
    FORCE_LAW_TRY(force_law_set(law, share));
    return force_law_checked(law, law->calls.step(law->instance, time, h, 0), "fmi2DoStep");
}

static inline int force_law_ramped(ForceLaw *law, double h)
{
    static const int orders[2] = {1, 1};
    const double slopes[2] = {law->scale[0] * (law->trial[1] - law->velocity) / h,
                              law->scale[1] * (law->trial[2] - law->displacement) / h};
    FORCE_LAW_TRY(force_law_set(law, 0.0));
    FORCE_LAW_TRY(force_law_checked(
        law, law->calls.set_slopes(law->instance, law->references, (size_t)law->width, orders, slopes),
        "fmi2SetRealInputDerivatives"));
    return force_law_checked(law, law->calls.step(law->instance, law->time, h, 0), "fmi2DoStep");
}

/* Steps from the accepted to the trial point. */
static inline int force_law_advance(ForceLaw *law)
{
    const double h = law->trial[0] - law->time, first = h * (1.0 - FORCE_LAW_END_PART);
    if (h <= FORCE_LAW_SHORTEST) {
        return force_law_held(law, 1.0, law->time, FORCE_LAW_SHORTEST);
    }
    if (law->ramps) {
        return force_law_ramped(law, h);
    }
    FORCE_LAW_TRY(force_law_held(law, (0.5 - FORCE_LAW_END_PART) / (1.0 - FORCE_LAW_END_PART), law->time, first));
    return force_law_held(law, 1.0, law->time + first, h - first);
}

static inline int force_law_get(ForceLaw *law, double *force)
{
    double value = 0.0;
    FORCE_LAW_TRY(force_law_checked(law, law->calls.get_real(law->instance, law->references + 2, 1, &value), "fmi2GetReal"));
    *force = value / law->scale[2];
    return 0;
}

/* Stores the trial point after a check. */
static inline int force_law_try(ForceLaw *law, double time, double velocity, double displacement)
{
    const double rest = (time - time) + (velocity - velocity) + (displacement - displacement);
    if (!law->started) {
        return force_law_fails(law, "the force law has not started; call force_law_start first");
    }
    if (!(rest == 0.0)) {
        return force_law_fails(law, "time %g s, velocity %g m/s, displacement %g m: a value is not finite; the integrator "
                                    "diverged, or a value was not computed", time, velocity, displacement);
    }
    if (time < law->time - FORCE_LAW_SHORTEST) {
        return force_law_fails(law, "time %.9g s is before the last accepted time, %.9g s; accept a point only after the "
                                    "integrator's step is final", time, law->time);
    }
    law->trial[0] = time;
    law->trial[1] = velocity;
    law->trial[2] = displacement;
    return 0;
}

static inline void force_law_keep(ForceLaw *law, double force)
{
    law->time = law->trial[0] > law->time + FORCE_LAW_SHORTEST ? law->trial[0] : law->time;
    law->velocity = law->trial[1];
    law->displacement = law->trial[2];
    law->force = force;
    law->has_trial = 0;
}

/* ---- Start ----------------------------------------------------------------------------------------------------------- */

/* Starts in equilibrium at a velocity and a displacement; a second call starts again. */
static inline int force_law_start(ForceLaw *law, double time, double velocity, double displacement, double *force)
{
    const ForceLawCalls *calls = &law->calls;
    if (law->instance == NULL) {
        return force_law_fails(law, "the force law is not open; call force_law_open first");
    }
    if (law->started && calls->reset == NULL) {
        return force_law_fails(law, "the FMU has no fmi2Reset; close the force law and open it again");
    }
    if (law->started) {
        const size_t count = (size_t)law->parameter_count;
        FORCE_LAW_TRY(force_law_checked(law, calls->reset(law->instance), "fmi2Reset"));
        FORCE_LAW_TRY(force_law_checked(
            law, calls->set_real(law->instance, law->parameters, count, law->parameter_values), "fmi2SetReal"));
    }
    law->started = 1;
    law->time = time;
    law->rate = 0.0;
    FORCE_LAW_TRY(force_law_try(law, time, velocity, displacement));
    FORCE_LAW_TRY(force_law_checked(law, calls->setup(law->instance, 0, 0.0, time, 0, 0.0), "fmi2SetupExperiment"));
    FORCE_LAW_TRY(force_law_checked(law, calls->enter(law->instance), "fmi2EnterInitializationMode"));
    FORCE_LAW_TRY(force_law_set(law, 1.0));
    FORCE_LAW_TRY(force_law_checked(law, calls->leave(law->instance), "fmi2ExitInitializationMode"));
    FORCE_LAW_TRY(force_law_get(law, force));
    force_law_keep(law, *force);
    return law->states ? force_law_checked(law, calls->get_state(law->instance, &law->state), "fmi2GetFMUstate") : 0;
}

/* ---- Loop C: the force at any trial point ------------------------------------------------------------------------------ */

/* Returns the force at a trial point; the accepted point remains. */
static inline int force_law_force(ForceLaw *law, double time, double velocity, double displacement, double *force)
{
    law->has_trial = 0;
    FORCE_LAW_TRY(force_law_try(law, time, velocity, displacement));
    if (!law->states) {
        return force_law_fails(law, "the FMU cannot save its state (canGetAndSetFMUstate is false); use force_law_hold or "
                                    "force_law_extrapolate with a smaller step");
    }
    FORCE_LAW_TRY(force_law_checked(law, law->calls.set_state(law->instance, law->state), "fmi2SetFMUstate"));
    FORCE_LAW_TRY(force_law_advance(law));
    FORCE_LAW_TRY(force_law_get(law, force));
    law->has_trial = 1;
    return 0;
}

/* Makes a point the accepted one, after the integrator has accepted its step. */
static inline int force_law_accept(ForceLaw *law, double time, double velocity, double displacement, double *force)
{
    const int is_there = law->has_trial && law->trial[0] == time && law->trial[1] == velocity &&
                         law->trial[2] == displacement;
    FORCE_LAW_TRY(is_there ? force_law_get(law, force) : force_law_force(law, time, velocity, displacement, force));
    if (time - law->time > FORCE_LAW_SHORTEST) {
        FORCE_LAW_TRY(force_law_checked(law, law->calls.get_state(law->instance, &law->state), "fmi2GetFMUstate"));
    }
    force_law_keep(law, *force);
    return 0;
}

/* Returns the slope of the force about a trial point with respect to its velocity (1) or displacement (2): the central
   difference of the two inner or the two outer of four intervals, whichever pair differs less. The force has tiny jumps
   where a law divides its step into one more piece, and that pair contains none. */
static inline int force_law_slope(ForceLaw *law, const double point[3], int which, double *slope)
{
    double slopes[4], last = 0.0, before = 0.0;
    for (int j = 0; j < 5; j++) {
        double at[3], force = 0.0;
        memcpy(at, point, sizeof at);
        at[which] += (j - 2) * FORCE_LAW_DIFFERENCE;
        FORCE_LAW_TRY(force_law_force(law, at[0], at[1], at[2], &force));
        if (j > 0) {
            slopes[j - 1] = (force - last) / (at[which] - before);
        }
        last = force;
        before = at[which];
    }
    const int inner = fabs(slopes[1] - slopes[2]) <= fabs(slopes[0] - slopes[3]);
    *slope = inner ? 0.5 * (slopes[1] + slopes[2]) : 0.5 * (slopes[0] + slopes[3]);
    return 0;
}

/* Returns the derivatives of force_law_force [N.s/m], [N/m], for implicit integrators. */
static inline int force_law_jacobian(ForceLaw *law, double time, double velocity, double displacement, double *by_velocity,
                                     double *by_displacement)
{
    const double point[3] = {time, velocity, displacement};
    *by_displacement = 0.0;
    FORCE_LAW_TRY(force_law_slope(law, point, 1, by_velocity));
    FORCE_LAW_TRY(law->width == 2 ? force_law_slope(law, point, 2, by_displacement) : 0);
    law->has_trial = 0;
    return 0;
}

/* ---- Loops A and B: one force for each step of a host that cannot repeat ------------------------------------------------ */

/* Loop A: returns the force to hold from `time` for `h`, with the velocity and displacement of `time`. */
static inline int force_law_hold(ForceLaw *law, double time, double h, double velocity, double displacement, double *force)
{
    if (!(h > FORCE_LAW_SHORTEST) || fabs(time - law->time) > FORCE_LAW_SHORTEST * (fabs(time) > 1.0 ? fabs(time) : 1.0)) {
        return force_law_fails(law, "the step from %.9g s by %g s must be positive and begin where the last one ended, at "
                                    "%.9g s", time, h, law->time);
    }
    FORCE_LAW_TRY(force_law_try(law, law->time + h, velocity, displacement));
    FORCE_LAW_TRY(force_law_held(law, 1.0, law->time, h));
    FORCE_LAW_TRY(force_law_get(law, force));
    force_law_keep(law, *force);
    return 0;
}

/* Loop B: returns the force to hold from `time` for `h`, with the velocity and displacement of `time`. */
static inline int force_law_extrapolate(ForceLaw *law, double time, double h, double velocity, double displacement,
                                        double *force)
{
    const double passed = time - law->time, before = law->force;
    double now = before;
    FORCE_LAW_TRY(force_law_try(law, time, velocity, displacement));
    if (passed > FORCE_LAW_SHORTEST) {
        FORCE_LAW_TRY(force_law_advance(law));
        FORCE_LAW_TRY(force_law_get(law, &now));
        force_law_keep(law, now);
        law->rate = (now - before) / passed;
    }
    *force = now + 0.5 * h * law->rate;
    return 0;
}

#ifdef __cplusplus
}
#endif

#endif
