/* Two FMUs in one program: a car and one of its shocks, coupled for some steps; prints the last force and velocity.
 *
 *     two_fmus
 *
 * CAR and SHOCK are the prefixes of the functions, CAR_GUID and SHOCK_GUID the GUIDs, the numbers are value references. */
#include <stdio.h>
#include <stdlib.h>

#include "fmi2FunctionTypes.h"

#define PASTE(prefix, name) prefix##name
#define OF(prefix, name) PASTE(prefix, name)
#define DECLARE(prefix) \
    extern fmi2InstantiateTYPE OF(prefix, fmi2Instantiate); \
    extern fmi2SetupExperimentTYPE OF(prefix, fmi2SetupExperiment); \
    extern fmi2EnterInitializationModeTYPE OF(prefix, fmi2EnterInitializationMode); \
    extern fmi2ExitInitializationModeTYPE OF(prefix, fmi2ExitInitializationMode); \
    extern fmi2SetRealTYPE OF(prefix, fmi2SetReal); \
    extern fmi2DoStepTYPE OF(prefix, fmi2DoStep); \
    extern fmi2GetRealTYPE OF(prefix, fmi2GetReal);
#define START(prefix, guid) \
    OF(prefix, fmi2Instantiate)(#prefix, fmi2CoSimulation, guid, "", &callbacks, fmi2False, fmi2False)
#define BEGIN(prefix, instance) \
    (OF(prefix, fmi2SetupExperiment)(instance, fmi2False, 0.0, 0.0, fmi2False, 0.0) | \
     OF(prefix, fmi2EnterInitializationMode)(instance) | OF(prefix, fmi2ExitInitializationMode)(instance))

DECLARE(CAR)
DECLARE(SHOCK)

static const fmi2CallbackFunctions callbacks = {NULL, calloc, free, NULL, NULL};

int main(void)
{
    static const fmi2ValueReference road = CAR_ROAD, car_force = CAR_FORCE, car_velocity = CAR_VELOCITY;
    static const fmi2ValueReference velocity = SHOCK_VELOCITY, force = SHOCK_FORCE;
    fmi2Component car = START(CAR, CAR_GUID), shock = START(SHOCK, SHOCK_GUID);
    int bad = car == NULL || shock == NULL || BEGIN(CAR, car) || BEGIN(SHOCK, shock);
    double height = 0.01, v = 0.0, f = 0.0;
    for (int k = 0; !bad && k < 200; k++) {
        const double time = 1e-3 * k;
        bad = OF(CAR, fmi2SetReal)(car, &road, 1, &height) | OF(CAR, fmi2SetReal)(car, &car_force, 1, &f) |
              OF(CAR, fmi2DoStep)(car, time, 1e-3, fmi2True) | OF(CAR, fmi2GetReal)(car, &car_velocity, 1, &v) |
              OF(SHOCK, fmi2SetReal)(shock, &velocity, 1, &v) | OF(SHOCK, fmi2DoStep)(shock, time, 1e-3, fmi2True) |
              OF(SHOCK, fmi2GetReal)(shock, &force, 1, &f);
    }
    printf("%a %a\n", f, v);
    return bad;
}
