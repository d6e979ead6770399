/* Random call sequences of FMI 3.0, valid and not, on one FMU: compiled together with its sources/ under sanitizers.
 *
 *     call_sequences_3 <calls> <seed> <threads>
 *
 * The checks are those of call_sequences.c. In intermediate updates the host sets inputs and makes calls that are not allowed there,
 * which are refused. No message names a function of FMI 2.0. */
#include "random_calls.h"

#include "fmi3Functions.h"

enum { INSTANCES = 3, SAVED_STATES = 4, LONGEST = 6, TIME = 1000000 };

typedef struct {
    fmi3Instance instance;
    fmi3FMUState states[SAVED_STATES];
    double time;
} Slot;

static __thread Slot slots[INSTANCES];
static __thread long messages, updates;

static void logger(fmi3InstanceEnvironment environment, fmi3Status status, fmi3String category, fmi3String message)
{
    (void)environment;
    messages++;
    if (category == NULL || message == NULL || strchr(message, '%') != NULL || message[0] == '\0' || status > fmi3Error ||
        strlen(message) >= MESSAGE_SIZE || strstr(message, "fmi2") != NULL) {
        fail("logger", "a message that no host can print");
    }
}

/* ---- The state before and after a call ------------------------------------------------------------------------------ */

static size_t snapshot(fmi3Instance instance, fmi3Byte **bytes)
{
    fmi3FMUState state = NULL;
    size_t size = 0;
    if (fmi3GetFMUState(instance, &state) != fmi3OK || fmi3SerializedFMUStateSize(instance, state, &size) != fmi3OK) {
        fail("fmi3GetFMUState", "refused");
    }
    *bytes = malloc(size);
    if (fmi3SerializeFMUState(instance, state, *bytes, size) != fmi3OK || fmi3FreeFMUState(instance, &state) != fmi3OK) {
        fail("fmi3SerializeFMUState", "refused");
    }
    return size;
}

static __thread fmi3Byte *before;
static __thread size_t before_size;

/* Whether a call that could not give a finite result did nothing but to bring the outputs up to date, as reading one does. */
static int only_updated(fmi3Instance c, const fmi3Byte *after, size_t size)
{
    const fmi3ValueReference output = an_output();
    double value;
    fmi3FMUState state = NULL;
    fmi3Byte *bytes;
    if (fmi3DeserializeFMUState(c, before, before_size, &state) != fmi3OK || fmi3SetFMUState(c, state) != fmi3OK ||
        fmi3FreeFMUState(c, &state) != fmi3OK || fmi3GetFloat64(c, &output, 1, &value, 1) != fmi3OK) {
        return 0;
    }
    const int equal = snapshot(c, &bytes) == size && memcmp(bytes, after, size) == 0;
    free(bytes);
    return equal;
}

static fmi3Status judged(Slot *slot, const char *name, fmi3Status status)
{
    fmi3Byte *after;
    count(name, status == fmi3OK);
    if (status != fmi3OK && status != fmi3Discard && status != fmi3Error) {
        fail(name, "returned a status that it may not");
    }
    if (status != fmi3OK) {
        const size_t size = snapshot(slot->instance, &after);
        if ((size != before_size || memcmp(before, after, size) != 0) &&
            !(status == fmi3Discard && only_updated(slot->instance, after, size))) {
            fail(name, "was refused and changed something all the same");
        }
        free(after);
    }
    return status;
}

/* ---- Arguments ------------------------------------------------------------------------------------------------------ */

typedef struct {
    fmi3ValueReference references[LONGEST];
    double numbers[LONGEST], results[LONGEST];
    fmi3Boolean booleans[LONGEST];
    fmi3Int32 integers[LONGEST];
    fmi3String strings[LONGEST];
    size_t count, values;
} Arguments;

static Arguments any_arguments(void)
{
    Arguments a = {.count = (size_t)below(LONGEST)};
    a.values = one_in(15) ? (size_t)below(LONGEST) : a.count;
    for (int k = 0; k < LONGEST; k++) {
        a.references[k] = one_in(12) ? TIME : any_reference();
        a.numbers[k] = plausible(a.references[k]);
        a.booleans[k] = below(2) != 0;
        a.integers[k] = below(5) - 1;
        a.strings[k] = one_in(4) ? NULL : "text";
    }
    return a;
}

/* ---- Intermediate updates --------------------------------------------------------------------------------------------- */

static void must_be_refused(const char *name, fmi3Status status)
{
    count(name, status == fmi3OK);
    if (status != fmi3Error) {
        fail(name, "was not refused in an intermediate update");
    }
}

static void meddle(Slot *slot)
{
    fmi3Instance instance = slot->instance;
    fmi3Boolean a, b, c;
    double time, x[CONTINUOUS_STATES + 1];
    const fmi3ValueReference reference = 0;
    switch (below(8)) {
    case 0: must_be_refused("nested fmi3DoStep", fmi3DoStep(instance, slot->time, 1e-3, 1, &a, &b, &c, &time)); break;
    case 1: must_be_refused("nested fmi3GetFloat64", fmi3GetFloat64(instance, &reference, 1, &time, 1)); break;
    case 2: must_be_refused("nested fmi3SetFMUState", fmi3SetFMUState(instance, slot->states[0])); break;
    case 3: must_be_refused("nested fmi3Reset", fmi3Reset(instance)); break;
    case 4: must_be_refused("nested fmi3FreeFMUState", fmi3FreeFMUState(instance, &slot->states[1])); break;
    case 5: must_be_refused("nested fmi3GetString", fmi3GetString(instance, NULL, 0, NULL, 0)); break;
    case 6: must_be_refused("nested fmi3Terminate", fmi3Terminate(instance)); break;
    default:
        must_be_refused("nested fmi3GetContinuousStates", fmi3GetContinuousStates(instance, x, CONTINUOUS_STATES));
        break;
    }
}

static void update(fmi3InstanceEnvironment environment, fmi3Float64 time, fmi3Boolean set, fmi3Boolean get,
                   fmi3Boolean finished, fmi3Boolean can_return, fmi3Boolean *early, fmi3Float64 *early_time)
{
    Slot *slot = (Slot *)environment;
    updates++;
    if (!set || get || finished || can_return || early == NULL || early_time == NULL) {
        fail("update", "asked for something that this FMU does not offer");
    }
    *early = below(2) != 0;
    *early_time = one_in(2) ? time : any_number();
    for (int calls = below(4); calls > 0; calls--) {
        Arguments a = any_arguments();
        if (one_in(4)) {
            meddle(slot);
        } else {
            const fmi3ValueReference input = (fmi3ValueReference)below(INPUTS);
            const double value = plausible(input_references[input]);
            count("update: an input", fmi3SetFloat64(slot->instance, &input_references[input], 1, &value, 1) == fmi3OK);
            count("update: fmi3SetFloat64",
                  fmi3SetFloat64(slot->instance, or_null(a.references), a.count, or_null(a.numbers), a.values) == fmi3OK);
        }
    }
}

/* ---- Calls ---------------------------------------------------------------------------------------------------------- */

static void instantiate(Slot *slot)
{
    const fmi3String name = one_in(9) ? or_null("") : "instance", token = one_in(9) ? or_null("{wrong}") : MODEL_GUID;
    const fmi3ValueReference *required = (const fmi3ValueReference *)input_references;
    const fmi3ValueReference other = any_reference();
    const fmi3LogMessageCallback log = one_in(4) ? NULL : logger;
    const fmi3Boolean logging = below(2) != 0;
    switch (below(8)) {
    case 0: case 1: case 2:
        slot->instance = fmi3InstantiateModelExchange(name, token, or_null("/nowhere/"), below(2) != 0, logging, slot, log);
        break;
    case 3:
        slot->instance = fmi3InstantiateScheduledExecution(name, token, NULL, 0, logging, slot, log, NULL, NULL, NULL);
        if (slot->instance != NULL) {
            fail("fmi3InstantiateScheduledExecution", "was not refused");
        }
        break;
    default:
        slot->instance = fmi3InstantiateCoSimulation(name, token, or_null("/nowhere/"), below(2) != 0, logging, one_in(9),
                                                     below(2) != 0, one_in(9) ? or_null((void *)&other) : required,
                                                     (size_t)below(2), slot, log, one_in(3) ? NULL : update);
        break;
    }
    slot->time = 0.0;
    count("fmi3Instantiate", slot->instance != NULL);
}

static void release(Slot *slot)
{
    for (int k = 0; k < SAVED_STATES; k++) {
        fmi3FreeFMUState(slot->instance, &slot->states[k]);
    }
    fmi3FreeInstance(slot->instance);
    slot->instance = NULL;
    count("fmi3FreeInstance", 1);
}

static void step(Slot *slot)
{
    const double h = one_in(10) ? any_step() : pow(10.0, uniform(-7.0, -1.3));
    const double time = one_in(20) ? any_number() : slot->time;
    fmi3Boolean event = 1, end = 1, early = 1;
    double last = NAN;
    if (judged(slot, "fmi3DoStep", fmi3DoStep(slot->instance, time, h, below(2) != 0, or_null(&event), or_null(&end),
                                              or_null(&early), or_null(&last))) == fmi3OK) {
        if (event || end || early || !(last == time + h)) {
            fail("fmi3DoStep", "did not report a whole step");
        }
        slot->time = last;
    }
}

/* The time after a state was restored. */
static void look_at_the_time(Slot *slot)
{
    const fmi3ValueReference reference = TIME;
    if (fmi3GetFloat64(slot->instance, &reference, 1, &slot->time, 1) != fmi3OK) {
        fail("fmi3GetFloat64", "could not read the time");
    }
}

static void exchange_states(Slot *slot, int choice)
{
    fmi3Instance instance = slot->instance;
    double x[CONTINUOUS_STATES + 4];
    const size_t n = any_count(CONTINUOUS_STATES);
    fmi3Status status;
    for (int k = 0; k < CONTINUOUS_STATES + 4; k++) {
        x[k] = one_in(60) ? any_number() : (k < CONTINUOUS_STATES ? nominal_states[k] : 1.0) * uniform(-2.0, 2.0);
    }
    switch (choice) {
    case 0: judged(slot, "fmi3SetContinuousStates", fmi3SetContinuousStates(instance, or_null(x), n)); return;
    case 1: judged(slot, "fmi3GetNominals", fmi3GetNominalsOfContinuousStates(instance, or_null(x), n)); return;
    case 2:
        status = judged(slot, "fmi3GetContinuousStates", fmi3GetContinuousStates(instance, or_null(x), n));
        break;
    default:
        status = judged(slot, "fmi3GetDerivatives", fmi3GetContinuousStateDerivatives(instance, or_null(x), n));
        break;
    }
    if (status == fmi3OK) {
        all_finite("states", x, n);
    }
}

static void exchange_modes(Slot *slot, int choice)
{
    fmi3Instance instance = slot->instance;
    fmi3Boolean a = 1, b = 1, c = 1, d = 1, e = 1;
    double x;
    size_t size;
    switch (choice) {
    case 0: judged(slot, "fmi3EnterEventMode", fmi3EnterEventMode(instance)); break;
    case 1:
        if (judged(slot, "fmi3UpdateDiscreteStates",
                   fmi3UpdateDiscreteStates(instance, or_null(&a), or_null(&b), or_null(&c), or_null(&d), or_null(&e),
                                            or_null(&x))) == fmi3OK && (a || b || c || d || e)) {
            fail("fmi3UpdateDiscreteStates", "reported an event");
        }
        break;
    case 2: case 3: judged(slot, "fmi3EnterContinuousTimeMode", fmi3EnterContinuousTimeMode(instance)); break;
    case 4: judged(slot, "fmi3SetTime", fmi3SetTime(instance, one_in(9) ? any_number() : uniform(0.0, 1e3))); break;
    case 5: judged(slot, "fmi3GetEventIndicators", fmi3GetEventIndicators(instance, or_null(&x), (size_t)below(2))); break;
    case 6: judged(slot, "fmi3EvaluateDiscreteStates", fmi3EvaluateDiscreteStates(instance)); break;
    case 7:
        judged(slot, "fmi3GetNumberOf...", fmi3GetNumberOfContinuousStates(instance, or_null(&size)));
        judged(slot, "fmi3GetNumberOf...", fmi3GetNumberOfEventIndicators(instance, or_null(&size)));
        break;
    default:
        judged(slot, "fmi3CompletedIntegratorStep",
               fmi3CompletedIntegratorStep(instance, below(2) != 0, or_null(&a), or_null(&b)));
        break;
    }
}

static void read_and_write(Slot *slot, int choice)
{
    fmi3Instance instance = slot->instance;
    Arguments a = any_arguments(), known = any_arguments();
    switch (choice) {
    case 0:
        if (judged(slot, "fmi3GetFloat64",
                   fmi3GetFloat64(instance, or_null(a.references), a.count, or_null(a.results), a.values)) == fmi3OK) {
            all_finite("fmi3GetFloat64", a.results, a.count);
        }
        break;
    case 1:
        judged(slot, "fmi3SetFloat64",
               fmi3SetFloat64(instance, or_null(a.references), a.count, or_null(a.numbers), a.values));
        break;
    case 2:
        judged(slot, "fmi3GetBoolean",
               fmi3GetBoolean(instance, or_null(a.references), a.count, or_null(a.booleans), a.values));
        break;
    case 3:
        judged(slot, "fmi3SetBoolean",
               fmi3SetBoolean(instance, or_null(a.references), a.count, or_null(a.booleans), a.values));
        break;
    case 4:
        judged(slot, "fmi3GetString", fmi3GetString(instance, or_null(a.references), a.count, or_null(a.strings), a.values));
        break;
    case 5:
        judged(slot, "fmi3SetInt32", fmi3SetInt32(instance, or_null(a.references), a.count, or_null(a.integers), a.values));
        break;
    case 6:
        judged(slot, "fmi3GetOutputDerivatives",
               fmi3GetOutputDerivatives(instance, or_null(a.references), a.count, or_null(a.integers), or_null(a.results),
                                        a.values));
        break;
    case 7:
        judged(slot, "fmi3GetAdjointDerivative",
               fmi3GetAdjointDerivative(instance, or_null(a.references), a.count, or_null(known.references), known.count,
                                        or_null(a.numbers), a.values, or_null(known.results), known.values));
        break;
    default:
        judged(slot, "fmi3GetDirectionalDerivative",
               fmi3GetDirectionalDerivative(instance, or_null(a.references), a.count, or_null(known.references),
                                            known.count, or_null(known.numbers), known.values, or_null(a.results),
                                            a.values));
        break;
    }
}

static void take_forged(Slot *slot, fmi3Byte *bytes, size_t size)
{
    fmi3FMUState state = NULL;
    forge((fmi2Byte *)bytes, size);
    if (judged(slot, "forged state", fmi3DeserializeFMUState(slot->instance, bytes, size, &state)) != fmi3OK) {
        return;
    }
    judged(slot, "forged state set", fmi3SetFMUState(slot->instance, state));
    fmi3FreeFMUState(slot->instance, &state);
    look_at_the_time(slot);
}

static void refuse_foreign(Slot *slot, const fmi3Byte *bytes, size_t size)
{
    fmi3FMUState state = NULL;
    fmi3Byte *other = (fmi3Byte *)foreign((const fmi2Byte *)bytes, &size);
    if (judged(slot, "foreign state", fmi3DeserializeFMUState(slot->instance, other, size, &state)) == fmi3OK) {
        fail("fmi3DeserializeFMUState", "took a foreign state");
    }
    free(other);
}

static void save_and_restore(Slot *slot, int choice)
{
    fmi3Instance instance = slot->instance;
    fmi3FMUState *state = &slot->states[below(SAVED_STATES)];
    fmi3Byte *bytes;
    const size_t size = snapshot(instance, &bytes);
    size_t room = size;
    switch (choice) {
    case 0: judged(slot, "fmi3GetFMUState", fmi3GetFMUState(instance, or_null(state))); break;
    case 1:
        if (judged(slot, "fmi3SetFMUState", fmi3SetFMUState(instance, *state)) == fmi3OK) {
            look_at_the_time(slot);
        }
        break;
    case 2: judged(slot, "fmi3FreeFMUState", fmi3FreeFMUState(instance, or_null(state))); break;
    case 3:
        judged(slot, "fmi3SerializedFMUStateSize", fmi3SerializedFMUStateSize(instance, *state, or_null(&room)));
        judged(slot, "fmi3SerializeFMUState",
               fmi3SerializeFMUState(instance, *state, or_null(bytes), one_in(5) ? 3 : size));
        break;
    case 4: take_forged(slot, bytes, size); break;
    case 5: refuse_foreign(slot, bytes, size); break;
    default:
        judged(slot, "fmi3DeserializeFMUState",
               fmi3DeserializeFMUState(instance, or_null(bytes), one_in(5) ? size - 1 : size, or_null(state)));
        break;
    }
    free(bytes);
}

static void begin(Slot *slot)
{
    const double start = one_in(10) ? any_number() : 0.0, stop = one_in(4) ? any_number() : 1e3;
    if (judged(slot, "fmi3EnterInitializationMode",
               fmi3EnterInitializationMode(slot->instance, below(2) != 0, any_number(), start, below(2) != 0, stop)) ==
        fmi3OK) {
        slot->time = start;
    }
}

static void ask(Slot *slot, int choice)
{
    fmi3Instance instance = slot->instance;
    const fmi3String categories[] = {"logAll", one_in(2) ? "logStatusError" : or_null("nonsense")};
    size_t n;
    switch (choice) {
    case 0: judged(slot, "fmi3EnterStepMode", fmi3EnterStepMode(instance)); break;
    case 1: judged(slot, "fmi3EnterConfigurationMode", fmi3EnterConfigurationMode(instance)); break;
    case 2: judged(slot, "fmi3ExitConfigurationMode", fmi3ExitConfigurationMode(instance)); break;
    case 3: judged(slot, "fmi3ActivateModelPartition", fmi3ActivateModelPartition(instance, 0, 0.0)); break;
    case 4: judged(slot, "fmi3Get...Dependencies", fmi3GetNumberOfVariableDependencies(instance, any_reference(), &n)); break;
    default:
        judged(slot, "fmi3SetDebugLogging",
               fmi3SetDebugLogging(instance, below(2) != 0, (size_t)below(3), or_null((void *)categories)));
        break;
    }
}

static void live(Slot *slot)
{
    if (one_in(4)) {
        if (one_in(3)) {
            exchange_modes(slot, below(9));
        } else {
            exchange_states(slot, below(5));
        }
        return;
    }
    switch (below(40)) {
    case 0: release(slot); break;
    case 1: judged(slot, "fmi3Reset", fmi3Reset(slot->instance)); slot->time = 0.0; break;
    case 2: judged(slot, "fmi3Terminate", one_in(10) ? fmi3Terminate(slot->instance) : fmi3Error); break;
    case 3: case 4: case 5: begin(slot); break;
    case 6: case 7: judged(slot, "fmi3ExitInitializationMode", fmi3ExitInitializationMode(slot->instance)); break;
    case 8: ask(slot, below(6)); break;
    case 9: case 10: case 11: case 12: save_and_restore(slot, below(7)); break;
    case 13: case 14: case 15: case 16: case 17: case 18: case 19: case 20: step(slot); break;
    default: read_and_write(slot, one_in(2) ? below(2) : below(9)); break;
    }
}

static void *play(void *given)
{
    const Play *own = given;
    begin_randomly(own->seed);
    for (long k = 0; k < own->calls; k++) {
        Slot *slot = &slots[below(INSTANCES)];
        if (slot->instance == NULL) {
            instantiate(slot);
            continue;
        }
        before_size = snapshot(slot->instance, &before);
        live(slot);
        free(before);
    }
    for (int k = 0; k < INSTANCES; k++) {
        if (slots[k].instance != NULL) {
            release(&slots[k]);
        }
    }
    print_counts();
    printf("%ld messages, %ld updates\n", messages, updates);
    return NULL;
}

int main(int argc, char *argv[])
{
    return play_all(argc, argv);
}
