/* Messages for variables that cannot be read or set, kept apart from the code that runs in every step. */
#include "calls.h"

void not_known(const Component *c, const char *function, fmi2ValueReference reference, Kind kind)
{
    Message message = {.length = 0};
    say(&message, "value reference ");
    say_number(&message, (double)reference);
    say(&message, kind == REAL ? " is not a Real variable of this FMU" : " is not a Boolean variable of this FMU");
    refused(c, function, message.text);
}

static const char *reason_not_to_set(const Variable *variable)
{
    if (!variable->settable) {
        return " is computed by the FMU and cannot be set";
    }
    if (!(variable->settable & INSTANTIATED)) {
        return " is a continuous state: it can be set in event mode and continuous-time mode of model exchange only";
    }
    return variable->settable & EVENT ? " is a parameter: set it in event mode, not in continuous-time mode"
                                      : " is fixed: set it before initialization ends";
}

int not_settable(const Component *c, const char *function, const Variable *variable)
{
    Message message = {.length = 0};
    say(&message, variable->name);
    say(&message, reason_not_to_set(variable));
    refused(c, function, message.text);
    return 0;
}

/* "must be finite", "must be at least 0 and finite", "must be at least 0.001 and at most 10". */
static void say_range(Message *message, const Variable *variable)
{
    const int low = variable->minimum > -NO_LIMIT, high = variable->maximum < NO_LIMIT;
    say(message, " must be ");
    if (low) {
        say(message, "at least ");
        say_number(message, variable->minimum);
        say(message, " and ");
    }
    if (high) {
        say(message, "at most ");
        say_number(message, variable->maximum);
    }
    say(message, high ? "" : "finite");
}

int out_of_range(const Component *c, const char *function, const Variable *variable, double value)
{
    Message message = {.length = 0};
    say(&message, variable->name);
    say(&message, " = ");
    say_number(&message, value);
    say(&message, variable->unit[0] == '\0' ? "" : " ");
    say(&message, variable->unit);
    say_range(&message, variable);
    say(&message, "; the old value is kept");
    refused(c, function, message.text);
    return 0;
}
