/* Functions shared between source files. Each file calls those above it only.
 *
 * A call that is refused returns fmi2Error, logs the reason, and changes nothing: the instance continues as if the call had not
 * been made. Everything is checked before anything is written. */
#ifndef EIGHTPOST_CALLS_H
#define EIGHTPOST_CALLS_H

#include "instance.h"

/* logging.c: log a message (warnings and errors always, others if debug logging is on); refuse a call; log that a call is not
 * allowed in this phase, and return NULL. */
void logged(const Component *c, fmi2Status status, const char *text);
fmi2Status refused(const Component *c, const char *function, const char *reason);
Component *out_of_phase(const Component *c, const char *function);

/* The component if the function may be called in its phase (FMI 2.0.4, 4.2.4), otherwise NULL. */
static inline Component *entered(fmi2Component instance, const char *function, int phases)
{
    Component *c = (Component *)instance;
    return c == NULL || c->memory.phase & phases ? c : out_of_phase(c, function);
}

/* memory.c: zeroed memory from the host; the values of a new instance; whether inputs, outputs and local variables are finite. */
void *allocated(const Component *c, size_t size);
void start_over(Memory *m);
int signals_are_finite(const Memory *m);

/* update.c: 0 and a message if parameters contradict each other; set outputs and state from inputs and parameters, 0 and a message
 * if there is no such start; refuse a result that is not finite. In initialization mode and in model exchange, compute outputs
 * after a change of parameters, inputs or states: fmi2Error if that is not possible, fmi2Discard if a result is not finite. */
int fits(const Component *c, const char *function);
int started(Component *c, const char *function);
fmi2Status not_finite(const Component *c, const char *function);
fmi2Status updated(Component *c, const char *function);

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

/* state_check.c: 0 and the reason if no instance of this kind can have such a memory. */
int is_possible(const Memory *m, int is_model_exchange, Message *why);

/* step.c: whether a step begins at the end of the last one and ends by the stop time; a message if not. */
int is_next_step(const Component *c, double time, double h);

#endif
