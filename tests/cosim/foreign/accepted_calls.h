/* The FMI calls that an FMU without a fault accepts and ignores, and its versions. */
const char *fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }
const char *fmi2GetVersion(void) { return fmi2Version; }
#define ACCEPTED(name, ...) fmi2Status name(fmi2Component c, ##__VA_ARGS__) { return fmi2OK; }
ACCEPTED(fmi2SetDebugLogging, fmi2Boolean on, size_t n, const fmi2String categories[])
ACCEPTED(fmi2SetupExperiment, fmi2Boolean td, fmi2Real t, fmi2Real start, fmi2Boolean sd, fmi2Real stop)
ACCEPTED(fmi2EnterInitializationMode)
ACCEPTED(fmi2ExitInitializationMode)
ACCEPTED(fmi2Terminate)
