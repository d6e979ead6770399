/* The memory of an instance: from the host, and its values at first. */
#include <string.h>

#include "calls.h"
#include "elementary.h"

void *allocated(const Component *c, size_t size)
{
    void *memory = c->allocate(1, size);
    if (memory != NULL) {
        memset(memory, 0, size);
    }
    return memory;
}

void start_over(Memory *m)
{
    memset(m, 0, sizeof *m);
    memcpy(m->values.at, start_values, sizeof m->values.at);
    memcpy(m->flag, start_flags, sizeof m->flag);
    m->phase = INSTANTIATED;
    m->stop = NO_LIMIT;
    m->stale = CHANGED;
}

int signals_are_finite(const Memory *m)
{
    int finite = 1;
    for (int k = 0; k < SIGNALS; k++) {
        finite &= is_finite(value_of(m, k));
    }
    return finite;
}
