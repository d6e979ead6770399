/* Three FMUs in one program: a shock of FMI 2.0, the same of FMI 3.0 and another of FMI 3.0; prints the force of each after some
 * steps.
 *
 *     three_fmus
 *
 * FIRST and SECOND are the prefixes of the functions of FMI 3.0; those of the FMU of FMI 2.0 begin with lpnl2_. */
#include <stdio.h>
#include <stdlib.h>

#include "fmi2FunctionTypes.h"
#include "fmi3FunctionTypes.h"

#define PASTE(prefix, name) prefix##name
#define OF(prefix, name) PASTE(prefix, name)
#define DECLARE(prefix) \
    extern fmi3InstantiateCoSimulationTYPE OF(prefix, fmi3InstantiateCoSimulation); \
    extern fmi3EnterInitializationModeTYPE OF(prefix, fmi3EnterInitializationMode); \
    extern fmi3ExitInitializationModeTYPE OF(prefix, fmi3ExitInitializationMode); \
    extern fmi3SetFloat64TYPE OF(prefix, fmi3SetFloat64); \
    extern fmi3GetFloat64TYPE OF(prefix, fmi3GetFloat64); \
    extern fmi3DoStepTYPE OF(prefix, fmi3DoStep);
#define RUN(prefix, token)                                                                                              \
    do {                                                                                                                \
        fmi3Instance c = OF(prefix, fmi3InstantiateCoSimulation)(#prefix, token, NULL, 0, 0, 0, 0, NULL, 0, NULL, NULL, \
                                                                 NULL);                                                 \
        fmi3Boolean a, b, e;                                                                                            \
        bad |= c == NULL || OF(prefix, fmi3EnterInitializationMode)(c, 0, 0.0, 0.0, 0, 0.0) ||                          \
               OF(prefix, fmi3ExitInitializationMode)(c);                                                               \
        for (int k = 0; !bad && k < STEPS; k++) {                                                                       \
            const double v = velocity(k);                                                                               \
            bad = OF(prefix, fmi3SetFloat64)(c, &input, 1, &v, 1) ||                                                    \
                  OF(prefix, fmi3DoStep)(c, 1e-3 * k, 1e-3, 1, &a, &b, &e, &time);                                      \
        }                                                                                                               \
        bad |= bad || OF(prefix, fmi3GetFloat64)(c, &output, 1, &force, 1);                                             \
        printf("%a\n", force);                                                                                          \
    } while (0)

extern fmi2InstantiateTYPE lpnl2_fmi2Instantiate;
extern fmi2SetupExperimentTYPE lpnl2_fmi2SetupExperiment;
extern fmi2EnterInitializationModeTYPE lpnl2_fmi2EnterInitializationMode;
extern fmi2ExitInitializationModeTYPE lpnl2_fmi2ExitInitializationMode;
extern fmi2SetRealTYPE lpnl2_fmi2SetReal;
extern fmi2GetRealTYPE lpnl2_fmi2GetReal;
extern fmi2DoStepTYPE lpnl2_fmi2DoStep;
DECLARE(FIRST)
DECLARE(SECOND)

enum { STEPS = 200 };

static double velocity(int k)
{
    return 0.01 * (k % 40 - 15);
}

int main(void)
{
    static const fmi2CallbackFunctions callbacks = {NULL, calloc, free, NULL, NULL};
    static const unsigned input = 0, output = 2;
    double force = 0.0, time = 0.0;
    fmi2Component c = lpnl2_fmi2Instantiate("c", fmi2CoSimulation, OLD_GUID, "", &callbacks, fmi2False, fmi2False);
    int bad = c == NULL || lpnl2_fmi2SetupExperiment(c, fmi2False, 0.0, 0.0, fmi2False, 0.0) ||
              lpnl2_fmi2EnterInitializationMode(c) || lpnl2_fmi2ExitInitializationMode(c);
    for (int k = 0; !bad && k < STEPS; k++) {
        const double v = velocity(k);
        bad = lpnl2_fmi2SetReal(c, &input, 1, &v) || lpnl2_fmi2DoStep(c, 1e-3 * k, 1e-3, fmi2True);
    }
    bad |= bad || lpnl2_fmi2GetReal(c, &output, 1, &force);
    printf("%a\n", force);
    RUN(FIRST, FIRST_TOKEN);
    RUN(SECOND, SECOND_TOKEN);
    return bad;
}
