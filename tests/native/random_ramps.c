/* Steps an FMU whose sources are linked in over random ramps and prints what it was given and what it returned:
 *
 *     random_ramps <steps>
 *
 * First a line with the value references of the inputs, and one with those of the outputs. Then a line for each step: its size,
 * the inputs at its start, their slopes, the outputs at its end, as hexadecimal numbers. */
#include <stdio.h>
#include <stdlib.h>

#include "component.h"

static uint64_t random_state = 1;

/* Between -1 and 1 (Knuth's linear congruential generator). */
static double random_number(void)
{
    random_state = random_state * UINT64_C(6364136223846793005) + UINT64_C(1442695040888963407);
    return (double)(int32_t)(random_state >> 32) / 2147483648.0;
}

static double amplitude(const Variable *input)
{
    switch (input->unit[0]) {
    case 'N': return 800.0;
    default: return input->unit[1] == '/' ? 0.6 : 0.01;
    }
}

static void print(const double *values, size_t count)
{
    for (size_t k = 0; k < count; k++) {
        printf(" %a", values[k]);
    }
}

static void print_references(const fmi2ValueReference *references, size_t count)
{
    for (size_t k = 0; k < count; k++) {
        printf(" %u", references[k]);
    }
    printf("\n");
}

static void find_outputs(fmi2ValueReference outputs[OUTPUTS])
{
    for (fmi2ValueReference reference = 0, count = 0; reference < REFERENCES && count < OUTPUTS; reference++) {
        const int place = variable_of_reference[reference];
        if (place >= 0 && variables[place].is_output) {
            outputs[count++] = reference;
        }
    }
}

static int step(fmi2Component instance, const fmi2ValueReference outputs[OUTPUTS], double *time, double from[INPUTS])
{
    fmi2Integer order[INPUTS];
    double slopes[INPUTS], results[OUTPUTS];
    const double h = 1e-3 * (1.01 + random_number());
    for (int k = 0; k < INPUTS; k++) {
        const double to = amplitude(&variables[k]) * random_number();
        order[k] = 1;
        slopes[k] = (to - from[k]) / h;
    }
    int bad = fmi2SetReal(instance, input_references, INPUTS, from) != fmi2OK;
    bad |= fmi2SetRealInputDerivatives(instance, input_references, INPUTS, order, slopes) != fmi2OK;
    bad |= fmi2DoStep(instance, *time, h, fmi2True) != fmi2OK;
    bad |= fmi2GetReal(instance, outputs, OUTPUTS, results) != fmi2OK;
    printf("%a", h);
    print(from, INPUTS);
    print(slopes, INPUTS);
    print(results, OUTPUTS);
    printf("\n");
    for (int k = 0; k < INPUTS; k++) {
        from[k] += slopes[k] * h;
    }
    *time += h;
    return bad;
}

int main(int count, char **arguments)
{
    static const fmi2CallbackFunctions callbacks = {NULL, calloc, free, NULL, NULL};
    fmi2ValueReference outputs[OUTPUTS];
    double time = 0.0, inputs[INPUTS] = {0.0};
    fmi2Component instance = fmi2Instantiate("one", fmi2CoSimulation, MODEL_GUID, "", &callbacks, fmi2False, fmi2False);
    int bad = instance == NULL || fmi2SetupExperiment(instance, fmi2False, 0.0, 0.0, fmi2False, 0.0) != fmi2OK ||
              fmi2EnterInitializationMode(instance) != fmi2OK || fmi2ExitInitializationMode(instance) != fmi2OK;
    find_outputs(outputs);
    print_references(input_references, INPUTS);
    print_references(outputs, OUTPUTS);
    for (long k = 0; !bad && k < (count > 1 ? strtol(arguments[1], NULL, 10) : 100); k++) {
        bad = step(instance, outputs, &time, inputs);
    }
    fmi2FreeInstance(instance);
    return bad;
}
