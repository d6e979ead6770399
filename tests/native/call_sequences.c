/* Random FMI call sequences, valid and not, on one FMU: compiled together with its sources/ under sanitizers.
 *
 *     call_sequences <calls> <seed> <threads>
 *
 * After every call: the status is one that the FMU may return, a refused call has changed nothing (its serialized state
 * is the same to the byte, but for outputs that it brought up to date), and what was read is finite. Some serialized states are changed and given a correct checksum, as
 * another program could do: they are refused with a message, or an instance continues from them. Prints how often
 * each function was called and accepted. */
#include "random_calls.h"

enum { INSTANCES = 3, SAVED_STATES = 4, LONGEST = 6 };

typedef struct {
    fmi2Component component;
    fmi2FMUstate states[SAVED_STATES];
    double time;
} Slot;

static __thread Slot slots[INSTANCES];
static __thread long messages;

static void logger(fmi2ComponentEnvironment environment, fmi2String name, fmi2Status status, fmi2String category,
                   fmi2String message, ...)
{
    (void)environment;
    messages++;
    if (name == NULL || category == NULL || message == NULL || strchr(message, '%') != NULL || message[0] == '\0' ||
        status > fmi2Error || strlen(message) >= MESSAGE_SIZE) {
        fail("logger", "a message that no host can print");
    }
}

static const fmi2CallbackFunctions callbacks = {logger, calloc, free, NULL, NULL};

/* ---- The state before and after a call ------------------------------------------------------------------------------ */

static size_t snapshot(fmi2Component c, fmi2Byte **bytes)
{
    fmi2FMUstate state = NULL;
    size_t size = 0;
    if (fmi2GetFMUstate(c, &state) != fmi2OK || fmi2SerializedFMUstateSize(c, state, &size) != fmi2OK) {
        fail("fmi2GetFMUstate", "refused");
    }
    *bytes = malloc(size);
    if (fmi2SerializeFMUstate(c, state, *bytes, size) != fmi2OK || fmi2FreeFMUstate(c, &state) != fmi2OK) {
        fail("fmi2SerializeFMUstate", "refused");
    }
    return size;
}

static __thread fmi2Byte *before;
static __thread size_t before_size;

/* Whether a call that could not give a finite result did nothing but to bring the outputs up to date, as reading one does. */
static int only_updated(fmi2Component c, const fmi2Byte *after, size_t size)
{
    const fmi2ValueReference output = an_output();
    double value;
    fmi2FMUstate state = NULL;
    fmi2Byte *bytes;
    if (fmi2DeSerializeFMUstate(c, before, before_size, &state) != fmi2OK || fmi2SetFMUstate(c, state) != fmi2OK ||
        fmi2FreeFMUstate(c, &state) != fmi2OK || fmi2GetReal(c, &output, 1, &value) != fmi2OK) {
        return 0;
    }
    const int equal = snapshot(c, &bytes) == size && memcmp(bytes, after, size) == 0;
    free(bytes);
    return equal;
}

static fmi2Status judged(Slot *slot, const char *name, fmi2Status status)
{
    fmi2Byte *after;
    count(name, status == fmi2OK);
    if (status != fmi2OK && status != fmi2Discard && status != fmi2Error) {
        fail(name, "returned a status that it may not");
    }
    if (status != fmi2OK) {
        const size_t size = snapshot(slot->component, &after);
        if ((size != before_size || memcmp(before, after, size) != 0) &&
            !(status == fmi2Discard && only_updated(slot->component, after, size))) {
            fail(name, "was refused and changed something all the same");
        }
        free(after);
    }
    return status;
}

/* ---- Arguments ------------------------------------------------------------------------------------------------------ */

typedef struct {
    fmi2ValueReference references[LONGEST];
    double numbers[LONGEST], results[LONGEST];
    fmi2Integer integers[LONGEST];
    fmi2Boolean booleans[LONGEST];
    fmi2String strings[LONGEST];
    size_t count;
} Arguments;

static Arguments any_arguments(void)
{
    Arguments a = {.count = (size_t)below(LONGEST)};
    for (int k = 0; k < LONGEST; k++) {
        a.references[k] = any_reference();
        a.numbers[k] = plausible(a.references[k]);
        a.integers[k] = one_in(4) ? below(5) - 1 : 1;
        a.booleans[k] = below(3);
        a.strings[k] = one_in(4) ? NULL : "text";
    }
    return a;
}

/* ---- Calls ---------------------------------------------------------------------------------------------------------- */

static void instantiate(Slot *slot)
{
    fmi2CallbackFunctions own = callbacks;
    if (one_in(4)) {
        own.allocateMemory = NULL;
    }
    if (one_in(4)) {
        own.logger = NULL;
    }
    slot->component = fmi2Instantiate(one_in(9) ? or_null("") : "instance",
                                      one_in(9) ? (fmi2Type)below(4) : one_in(2) ? fmi2ModelExchange : fmi2CoSimulation, one_in(9) ? or_null("{wrong}") : MODEL_GUID, or_null("file:///nowhere"), or_null(&own),
                                      below(2), below(2));
    slot->time = 0.0;
    count("fmi2Instantiate", slot->component != NULL);
}

static void release(Slot *slot)
{
    for (int k = 0; k < SAVED_STATES; k++) {
        fmi2FreeFMUstate(slot->component, &slot->states[k]);
    }
    fmi2FreeInstance(slot->component);
    slot->component = NULL;
    count("fmi2FreeInstance", 1);
}

static void step(Slot *slot)
{
    const double h = one_in(10) ? any_step() : pow(10.0, uniform(-7.0, -1.3));
    const double time = one_in(20) ? any_number() : slot->time;
    if (judged(slot, "fmi2DoStep", fmi2DoStep(slot->component, time, h, below(2))) == fmi2OK) {
        slot->time = time + h;
    }
}

/* ---- Model exchange --------------------------------------------------------------------------------------------------- */

static void exchange_states(Slot *slot, int choice)
{
    fmi2Component c = slot->component;
    double x[CONTINUOUS_STATES + 4];
    const size_t n = any_count(CONTINUOUS_STATES);
    for (int k = 0; k < CONTINUOUS_STATES + 4; k++) {
        x[k] = one_in(60) ? any_number() : (k < CONTINUOUS_STATES ? nominal_states[k] : 1.0) * uniform(-2.0, 2.0);
    }
    switch (choice) {
    case 0: judged(slot, "fmi2SetContinuousStates", fmi2SetContinuousStates(c, or_null(x), n)); break;
    case 1:
        if (judged(slot, "fmi2GetContinuousStates", fmi2GetContinuousStates(c, or_null(x), n)) == fmi2OK) {
            all_finite("fmi2GetContinuousStates", x, n);
        }
        break;
    case 2:
        judged(slot, "fmi2GetNominalsOfContinuousStates", fmi2GetNominalsOfContinuousStates(c, or_null(x), n));
        break;
    default:
        if (judged(slot, "fmi2GetDerivatives", fmi2GetDerivatives(c, or_null(x), n)) == fmi2OK) {
            all_finite("fmi2GetDerivatives", x, n);
        }
        break;
    }
}

static void exchange_modes(Slot *slot, int choice)
{
    fmi2Component c = slot->component;
    fmi2EventInfo info;
    fmi2Boolean event = 7, end = 7;
    double indicator;
    switch (choice) {
    case 0: judged(slot, "fmi2EnterEventMode", fmi2EnterEventMode(c)); break;
    case 1: judged(slot, "fmi2NewDiscreteStates", fmi2NewDiscreteStates(c, or_null(&info))); break;
    case 2: case 3: judged(slot, "fmi2EnterContinuousTimeMode", fmi2EnterContinuousTimeMode(c)); break;
    case 4: judged(slot, "fmi2SetTime", fmi2SetTime(c, one_in(9) ? any_number() : uniform(0.0, 1e3))); break;
    case 5:
        judged(slot, "fmi2GetEventIndicators", fmi2GetEventIndicators(c, or_null(&indicator), (size_t)below(2)));
        break;
    default:
        judged(slot, "fmi2CompletedIntegratorStep",
               fmi2CompletedIntegratorStep(c, below(2), or_null(&event), or_null(&end)));
        break;
    }
}

static void exchange(Slot *slot)
{
    if (one_in(3)) {
        exchange_modes(slot, below(7));
    } else {
        exchange_states(slot, below(5));
    }
}

static void begin(Slot *slot)
{
    const double start = one_in(10) ? any_number() : 0.0, stop = one_in(4) ? any_number() : 1e3;
    fmi2Component c = slot->component;
    if (judged(slot, "fmi2SetupExperiment", fmi2SetupExperiment(c, below(2), any_number(), start, below(2), stop)) ==
        fmi2OK) {
        slot->time = start;
    }
}

static void read_and_write(Slot *slot, int choice)
{
    fmi2Component c = slot->component;
    Arguments a = any_arguments();
    switch (choice) {
    case 0:
        if (judged(slot, "fmi2GetReal", fmi2GetReal(c, or_null(a.references), a.count, or_null(a.results))) == fmi2OK) {
            all_finite("fmi2GetReal", a.results, a.count);
        }
        break;
    case 1: judged(slot, "fmi2SetReal", fmi2SetReal(c, or_null(a.references), a.count, or_null(a.numbers))); break;
    case 2: judged(slot, "fmi2GetBoolean", fmi2GetBoolean(c, or_null(a.references), a.count, or_null(a.booleans))); break;
    case 3: judged(slot, "fmi2SetBoolean", fmi2SetBoolean(c, or_null(a.references), a.count, or_null(a.booleans))); break;
    case 4: judged(slot, "fmi2GetInteger", fmi2GetInteger(c, or_null(a.references), a.count, or_null(a.integers))); break;
    case 5: judged(slot, "fmi2SetInteger", fmi2SetInteger(c, or_null(a.references), a.count, or_null(a.integers))); break;
    case 6: judged(slot, "fmi2GetString", fmi2GetString(c, or_null(a.references), a.count, or_null(a.strings))); break;
    case 7: judged(slot, "fmi2SetString", fmi2SetString(c, or_null(a.references), a.count, or_null(a.strings))); break;
    case 8:
        judged(slot, "fmi2SetRealInputDerivatives",
               fmi2SetRealInputDerivatives(c, or_null(a.references), a.count, or_null(a.integers), or_null(a.numbers)));
        break;
    case 9:
        judged(slot, "fmi2GetRealOutputDerivatives",
               fmi2GetRealOutputDerivatives(c, or_null(a.references), a.count, or_null(a.integers), or_null(a.results)));
        break;
    default: {
        Arguments known = any_arguments();
        judged(slot, "fmi2GetDirectionalDerivative",
               fmi2GetDirectionalDerivative(c, or_null(a.references), a.count, or_null(known.references), known.count,
                                            or_null(known.numbers), or_null(a.results)));
        break;
    }
    }
}

static void take_forged(Slot *slot, fmi2Byte *bytes, size_t size)
{
    fmi2FMUstate state = NULL;
    forge(bytes, size);
    if (judged(slot, "forged state", fmi2DeSerializeFMUstate(slot->component, bytes, size, &state)) != fmi2OK) {
        return;
    }
    judged(slot, "forged state set", fmi2SetFMUstate(slot->component, state));
    fmi2FreeFMUstate(slot->component, &state);
    fmi2GetRealStatus(slot->component, fmi2LastSuccessfulTime, &slot->time);
}

static void refuse_foreign(Slot *slot, const fmi2Byte *bytes, size_t size)
{
    fmi2FMUstate state = NULL;
    fmi2Byte *other = foreign(bytes, &size);
    if (judged(slot, "foreign state", fmi2DeSerializeFMUstate(slot->component, other, size, &state)) == fmi2OK) {
        fail("fmi2DeSerializeFMUstate", "took a foreign state");
    }
    free(other);
}

static void save_and_restore(Slot *slot, int choice)
{
    fmi2Component c = slot->component;
    fmi2FMUstate *state = &slot->states[below(SAVED_STATES)];
    fmi2Byte *bytes;
    const size_t size = snapshot(c, &bytes);
    switch (choice) {
    case 0: judged(slot, "fmi2GetFMUstate", fmi2GetFMUstate(c, or_null(state))); break;
    case 1:
        if (judged(slot, "fmi2SetFMUstate", fmi2SetFMUstate(c, *state)) == fmi2OK) {
            fmi2GetRealStatus(c, fmi2LastSuccessfulTime, &slot->time);
        }
        break;
    case 2: judged(slot, "fmi2FreeFMUstate", fmi2FreeFMUstate(c, or_null(state))); break;
    case 3: {
        size_t room = size;
        judged(slot, "fmi2SerializedFMUstateSize", fmi2SerializedFMUstateSize(c, *state, or_null(&room)));
        judged(slot, "fmi2SerializeFMUstate", fmi2SerializeFMUstate(c, *state, or_null(bytes), one_in(5) ? 3 : size));
        break;
    }
    case 4: take_forged(slot, bytes, size); break;
    case 5: refuse_foreign(slot, bytes, size); break;
    default:
        if (one_in(2)) {
            bytes[below((int)size)] ^= (fmi2Byte)(1 << below(7));
            if (fmi2DeSerializeFMUstate(c, bytes, size, state) == fmi2OK) {
                fail("fmi2DeSerializeFMUstate", "took damaged bytes");
            }
        } else {
            judged(slot, "fmi2DeSerializeFMUstate",
                   fmi2DeSerializeFMUstate(c, or_null(bytes), one_in(5) ? size - 1 : size, or_null(state)));
        }
        break;
    }
    free(bytes);
}

static void ask(Slot *slot, int choice)
{
    fmi2Component c = slot->component;
    const fmi2StatusKind kind = (fmi2StatusKind)below(5);
    fmi2Status status;
    fmi2Real real;
    fmi2Integer integer;
    fmi2Boolean boolean;
    fmi2String string;
    switch (choice) {
    case 0: judged(slot, "fmi2GetStatus", fmi2GetStatus(c, kind, or_null(&status))); break;
    case 1: judged(slot, "fmi2GetRealStatus", fmi2GetRealStatus(c, kind, or_null(&real))); break;
    case 2: judged(slot, "fmi2GetIntegerStatus", fmi2GetIntegerStatus(c, kind, or_null(&integer))); break;
    case 3: judged(slot, "fmi2GetBooleanStatus", fmi2GetBooleanStatus(c, kind, or_null(&boolean))); break;
    case 4: judged(slot, "fmi2GetStringStatus", fmi2GetStringStatus(c, kind, or_null(&string))); break;
    case 5: judged(slot, "fmi2CancelStep", fmi2CancelStep(c)); break;
    default: {
        const fmi2String categories[] = {"logAll", one_in(2) ? "logStatusError" : or_null("nonsense")};
        judged(slot, "fmi2SetDebugLogging", fmi2SetDebugLogging(c, below(2), (size_t)below(3), or_null((void *)categories)));
        break;
    }
    }
}

static void live(Slot *slot)
{
    if (one_in(4)) {
        exchange(slot);
        return;
    }
    switch (below(40)) {
    case 0: release(slot); break;
    case 1: judged(slot, "fmi2Reset", fmi2Reset(slot->component)); slot->time = 0.0; break;
    case 2: judged(slot, "fmi2Terminate", one_in(10) ? fmi2Terminate(slot->component) : fmi2Error); break;
    case 3: begin(slot); break;
    case 4: case 5: judged(slot, "fmi2EnterInitializationMode", fmi2EnterInitializationMode(slot->component)); break;
    case 6: case 7: judged(slot, "fmi2ExitInitializationMode", fmi2ExitInitializationMode(slot->component)); break;
    case 8: ask(slot, below(7)); break;
    case 9: case 10: case 11: case 12: save_and_restore(slot, below(7)); break;
    case 13: case 14: case 15: case 16: case 17: case 18: case 19: case 20: step(slot); break;
    default: read_and_write(slot, one_in(2) ? below(2) : below(11)); break;
    }
}

static void *play(void *given)
{
    const Play *own = given;
    begin_randomly(own->seed);
    for (long k = 0; k < own->calls; k++) {
        Slot *slot = &slots[below(INSTANCES)];
        if (slot->component == NULL) {
            instantiate(slot);
            continue;
        }
        before_size = snapshot(slot->component, &before);
        live(slot);
        free(before);
    }
    for (int k = 0; k < INSTANCES; k++) {
        if (slots[k].component != NULL) {
            release(&slots[k]);
        }
    }
    print_counts();
    printf("%ld messages\n", messages);
    return NULL;
}

int main(int argc, char *argv[])
{
    return play_all(argc, argv);
}
