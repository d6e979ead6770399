/* FMI 3.0 around the core of fmus/common, whose functions are those of FMI 2.0: the model code is the same for both versions, and
 * so are the results. An FMI 3.0 library exports these functions only; those of the core are hidden (prefix.h). */
#ifndef EIGHTPOST_FMI3_INSTANCE_H
#define EIGHTPOST_FMI3_INSTANCE_H

#include "calls.h"
#include "fmi3Functions.h"

#define core_of fmi2FullName(core_of)
#define refused3 fmi2FullName(refused3)
#define has_all_values fmi2FullName(has_all_values)
#define accepts_no_other fmi2FullName(accepts_no_other)

typedef struct {
    Component *core;
    fmi3InstanceEnvironment environment;
    fmi3LogMessageCallback log;
    fmi3IntermediateUpdateCallback update;
    int is_updating; /* the host is in its callback for an intermediate update, where it may set inputs only */
} Instance;

/* fmi3_lifecycle.c: the core of an instance; NULL for no instance, or with a message in an intermediate update. Log a refused call
 * and return fmi3Error. */
Component *core_of(fmi3Instance instance, const char *function);
fmi3Status refused3(fmi3Instance instance, const char *function, const char *reason);

/* fmi3_variables.c: 0 and a message if a call has not as many values as references, because all variables are scalars. */
int has_all_values(fmi3Instance instance, const char *function, size_t references, size_t values);

/* fmi3_other_types.c: an empty list is accepted, because this FMU has no variable of that type; a reference is an error. */
fmi3Status accepts_no_other(fmi3Instance instance, const char *function, size_t n);

/* Value reference of the independent variable; builder/interface.py writes it into modelDescription.xml. */
enum { TIME_REFERENCE = 1000000 };

/* Both versions number their statuses alike, as far as this FMU uses them. */
static inline fmi3Status status3(fmi2Status status)
{
    return (fmi3Status)status;
}

/* Both versions have 32-bit references. */
static inline const fmi2ValueReference *references2(const fmi3ValueReference references[])
{
    typedef char same_size[sizeof(fmi2ValueReference) == sizeof(fmi3ValueReference) ? 1 : -1];
    (void)sizeof(same_size);
    return (const fmi2ValueReference *)references;
}

#endif
