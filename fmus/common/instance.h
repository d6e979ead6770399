/* One instance as the FMI functions use it: its memory, its host's callbacks, and functions shared between source files.
 *
 * A call that is refused returns fmi2Error, logs the reason, and changes nothing: the instance continues as if the call had not
 * been made. Everything is checked before anything is written. */
#ifndef EIGHTPOST_INSTANCE_H
#define EIGHTPOST_INSTANCE_H

#include "component.h"

typedef struct {
    Memory memory;
    void *work;
    char *name;
    fmi2CallbackLogger logger;
    fmi2CallbackFreeMemory release;
    fmi2CallbackAllocateMemory allocate;
    fmi2ComponentEnvironment environment;
    int logging;
    int categories;
    int is_wide; /* wide.h */
    int is_model_exchange;
    uint64_t tag; /* identifies states of this FMU */
} Component;

enum { EXCHANGING = EVENT | CONTINUOUS };
enum { SETTABLE = INSTANTIATED | INITIALIZING | STEPPING | EXCHANGING };
enum { READABLE = INITIALIZING | STEPPING | EXCHANGING | TERMINATED };
enum { ALIVE = INSTANTIATED | READABLE };

/* logging.c: log a message (warnings and errors always, others if debug logging is on); refuse a call; log that a call is not
 * allowed in this phase, and return NULL. */
void logged(const Component *c, fmi2Status status, const char *text);
fmi2Status refused(const Component *c, const char *function, const char *reason);
Component *out_of_phase(const Component *c, const char *function);

/* refusals.c: log a message; the last two functions return 0. */
void not_known(const Component *c, const char *function, fmi2ValueReference reference, Kind kind);
int not_settable(const Component *c, const char *function, const Variable *variable);
int out_of_range(const Component *c, const char *function, const Variable *variable, double value);

/* variables.c: 0 and a message if a reference in a list is unknown or of another type. */
int all_known(const Component *c, const char *function, const fmi2ValueReference vr[], size_t n, Kind kind);

/* derivatives.c: 0 and a message if a reference in a list cannot be an unknown of a derivative in this phase, or a known. */
int derivable(const Component *c, const char *function, const fmi2ValueReference vr[], size_t n, int is_unknown);

/* variables.c, derivatives.c: the calls of exchange.c with all checks, and a message for each refusal. */
fmi2Status get_reals(fmi2Component instance, const fmi2ValueReference vr[], size_t n, fmi2Real value[]);
fmi2Status set_reals(fmi2Component instance, const fmi2ValueReference vr[], size_t n, const fmi2Real value[]);
fmi2Status slopes_refused(fmi2Component instance, size_t n, int is_null);

/* fmu_state.c: tag of this FMU's states, for co-simulation or model exchange. A state of another FMU may be shorter, and reading it
 * would go beyond its end; a state of the other kind of instance has other modes. */
uint64_t state_tag(int is_model_exchange);

/* state_check.c: 0 and the reason if no instance of this kind can have such a memory. */
int is_possible(const Memory *m, int is_model_exchange, Message *why);

/* lifecycle.c: zeroed memory from the host; 0 and a message if parameters contradict each other; set outputs and state from
 * inputs and parameters, 0 and a message if there is no such start; whether inputs, outputs and local variables are finite. */
void *allocated(const Component *c, size_t size);
int fits(const Component *c, const char *function);
int started(Component *c, const char *function);
int signals_are_finite(const Memory *m);

/* step.c: whether a step begins at the end of the last one and ends by the stop time; a message if not. */
int is_next_step(const Component *c, double time, double h);

/* model_exchange.c: compute outputs after a change of parameters, inputs or states; fmi2Error if parameters contradict each other,
 * fmi2Discard if a result is not finite. Refuse a result that is not finite. */
fmi2Status evaluated(Component *c, const char *function);
fmi2Status not_finite(const Component *c, const char *function);

/* The component if the function may be called in its phase (FMI 2.0.4, 4.2.4), otherwise NULL. */
static inline Component *entered(fmi2Component instance, const char *function, int phases)
{
    Component *c = (Component *)instance;
    return c == NULL || c->memory.phase & phases ? c : out_of_phase(c, function);
}

/* NULL for an unknown reference. */
static inline const Variable *find_variable(fmi2ValueReference reference)
{
    const int position = reference < REFERENCES ? variable_of_reference[reference] : -1;
    return position < 0 ? NULL : &variables[position];
}

/* The variable of a reference that is known to exist. */
static inline const Variable *known_variable(fmi2ValueReference reference)
{
    return &variables[variable_of_reference[reference]];
}

/* Inputs are the first variables, so an index in `variables` is also the index in Values.at and in Memory.slope; -1 if the
 * reference is not that of an input. */
static inline int place_of_input(fmi2ValueReference reference)
{
    const uint16_t place = reference < REFERENCES ? (uint16_t)variable_of_reference[reference] : UINT16_MAX;
    return place < INPUTS ? place : -1;
}

static inline int is_input(const Variable *variable)
{
    return variable->kind == REAL && variable->index < INPUTS;
}

/* In initialization mode and in model exchange, update outputs after changes; a message if that is not possible. */
static inline fmi2Status updated(Component *c, const char *function)
{
    if (!c->memory.stale || !(c->memory.phase & (INITIALIZING | EXCHANGING))) {
        return fmi2OK;
    }
    if (c->memory.phase == INITIALIZING) {
        return started(c, function) ? fmi2OK : fmi2Error;
    }
    return evaluated(c, function);
}

#endif
