/* One instance as the FMI functions see it: its memory, its host's callbacks, and what the functions share.
 *
 * A call that is refused returns fmi2Error, says why, and changes nothing: the instance goes on as if it had not been made.
 * Everything is checked before anything is written. */
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
} Component;

enum { SETTABLE = INSTANTIATED | INITIALIZING | STEPPING };
enum { READABLE = INITIALIZING | STEPPING | TERMINATED };
enum { ALIVE = INSTANTIATED | READABLE };

/* logging.c: tell the host (warnings and worse always, the rest where debug logging is on); refuse a call; and the component
 * if the function may be called in its phase (FMI 2.0.4, 4.2.4), else NULL. */
void logged(const Component *c, fmi2Status status, const char *text);
fmi2Status refused(const Component *c, const char *function, const char *reason);
Component *entered(fmi2Component instance, const char *function, int phases);

/* variables.c: NULL for an unknown reference; 0 and a message for a list with one that is unknown or of another type. */
const Variable *find_variable(fmi2ValueReference reference);
int all_known(const Component *c, const char *function, const fmi2ValueReference vr[], size_t n, Kind kind);
int is_input(const Variable *variable);

/* lifecycle.c: memory from the host, zeroed; 1 if all signals are finite (outputs see every state); 0 and a message where parameters do not
 * fit each other; in initialization mode outputs that follow what was set, 0 and a message where there is no such start. */
void *allocated(const Component *c, size_t size);
int all_finite(const Memory *m);
int fits(const Component *c, const char *function);
int is_current(Component *c, const char *function);

#endif
