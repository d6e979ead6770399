/* Messages of an instance to its host, and checks whether a call is allowed in the current phase. */
#include <string.h>

#include "calls.h"

static const char *const CATEGORIES[] = {
    "logAll", "logStatusWarning", "logStatusDiscard", "logStatusError", "logStatusFatal",
};
enum { CATEGORY_COUNT = sizeof CATEGORIES / sizeof CATEGORIES[0] };

void logged(const Component *c, fmi2Status status, const char *text)
{
    const int category = status == fmi2OK ? 0 : (int)status;
    if (c->logger != NULL && (status >= fmi2Warning || (c->logging && (c->categories & 1 << category)))) {
        c->logger(c->environment, c->name, status, CATEGORIES[category], text);
    }
}

fmi2Status refused(const Component *c, const char *function, const char *reason)
{
    Message message = {.length = 0};
    say(&message, function);
    say(&message, ": ");
    say(&message, reason);
    logged(c, fmi2Error, message.text);
    return fmi2Error;
}

static const char *phase_name(int64_t phase)
{
    switch (phase) {
    case INSTANTIATED: return "before initialization mode";
    case INITIALIZING: return "in initialization mode";
    case STEPPING: return "between steps";
    case EVENT: return "in event mode";
    case CONTINUOUS: return "in continuous-time mode";
    default: return "after fmi2Terminate";
    }
}

Component *out_of_phase(const Component *c, const char *function)
{
    Message message = {.length = 0};
    say(&message, "is not allowed ");
    say(&message, phase_name(c->memory.phase));
    refused(c, function, message.text);
    return NULL;
}

fmi2Status fmi2SetDebugLogging(fmi2Component instance, fmi2Boolean on, size_t n, const fmi2String categories[])
{
    Component *c = entered(instance, "fmi2SetDebugLogging", ALIVE);
    int chosen = n == 0 ? ~0 : 0;
    if (c == NULL) {
        return fmi2Error;
    }
    if (n > 0 && categories == NULL) {
        return refused(c, "fmi2SetDebugLogging", "the list of categories is NULL");
    }
    for (size_t k = 0; k < n; k++) {
        int category = 0;
        while (category < CATEGORY_COUNT &&
               (categories[k] == NULL || strcmp(categories[k], CATEGORIES[category]) != 0)) {
            category++;
        }
        if (category == CATEGORY_COUNT) {
            return refused(c, "fmi2SetDebugLogging", "a category is not among those of modelDescription.xml");
        }
        chosen |= 1 << category;
    }
    c->logging = on != fmi2False;
    c->categories = chosen;
    return fmi2OK;
}
