/* A sticking valve as an FMU for co-simulation (FMI 2.0): loop current in, position and velocity of the stem out.

   A chamber with a first-order lag, a spring, Coulomb and Stribeck friction, and two travel stops, in steps of at most
   20 microseconds. docs/own-plant.md says how it is built. */

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define GUID "{6f0d1c9e-4b0a-4d1e-9c55-2f3a7f0b9d11}"
#define EXPORT __attribute__((visibility("default")))

enum { OK = 0, ERROR = 3 };
enum { CURRENT, POSITION, VELOCITY, VARIABLES };

typedef struct {
    double values[VARIABLES]; /* in mA, m, m/s */
    double pressure_pa;
} Valve;

static const double MASS_KG = 1.361, AREA_M2 = 0.06452, GAIN_PA_PER_MA = 5171.06775, SPRING_N_PER_M = 52538.0;
static const double STATIC_N = 1707.7, COULOMB_N = 1423.0, VISCOUS_N_S_PER_M = 612.9, STRIBECK_M_PER_S = 0.000254;
static const double LAG_S = 0.03, START_M = 0.05, STOP_M = 0.1397, LONGEST_STEP_S = 2e-5;

static void start(Valve *valve) {
    valve->pressure_pa = SPRING_N_PER_M * START_M / AREA_M2;
    valve->values[CURRENT] = valve->pressure_pa / GAIN_PA_PER_MA;
    valve->values[POSITION] = START_M;
    valve->values[VELOCITY] = 0.0;
}

static void step(Valve *valve, double h) {
    double x = valve->values[POSITION], v = valve->values[VELOCITY];
    double final_pa = GAIN_PA_PER_MA * valve->values[CURRENT];
    valve->pressure_pa = final_pa + (valve->pressure_pa - final_pa) * exp(-h / LAG_S);
    double pull_n = AREA_M2 * valve->pressure_pa - SPRING_N_PER_M * x;
    if (v == 0.0 && fabs(pull_n) <= STATIC_N) return;
    double along = v != 0.0 ? copysign(1.0, v) : copysign(1.0, pull_n), ratio = v / STRIBECK_M_PER_S;
    double dry_n = COULOMB_N + (STATIC_N - COULOMB_N) * exp(-ratio * ratio);
    double after = v + h * (pull_n - along * dry_n - VISCOUS_N_S_PER_M * v) / MASS_KG;
    if (after * along <= 0.0) after = 0.0; /* it sticks; the next step asks whether it can stay */
    x += h * after;
    if (x <= 0.0 || x >= STOP_M) after = 0.0;
    valve->values[POSITION] = fmin(fmax(x, 0.0), STOP_M);
    valve->values[VELOCITY] = after;
}

EXPORT const char *fmi2GetTypesPlatform(void) { return "default"; }
EXPORT const char *fmi2GetVersion(void) { return "2.0"; }
EXPORT int fmi2SetDebugLogging(void *c, int on, size_t n, const char *const names[]) { return OK; }

EXPORT void *fmi2Instantiate(const char *name, int kind, const char *guid, const char *resources,
                             const void *functions, int visible, int logs) {
    Valve *valve = kind == 1 && strcmp(guid, GUID) == 0 ? malloc(sizeof *valve) : NULL;
    if (valve) start(valve);
    return valve;
}
EXPORT void fmi2FreeInstance(void *c) { free(c); }

EXPORT int fmi2SetupExperiment(void *c, int bounded, double tolerance, double begin, int ends, double end) { return OK; }
EXPORT int fmi2EnterInitializationMode(void *c) { return OK; }
EXPORT int fmi2ExitInitializationMode(void *c) { return OK; }
EXPORT int fmi2Terminate(void *c) { return OK; }
EXPORT int fmi2Reset(void *c) { start(c); return OK; }

EXPORT int fmi2GetReal(void *c, const unsigned int which[], size_t n, double values[]) {
    for (size_t i = 0; i < n; i++) {
        if (which[i] >= VARIABLES) return ERROR;
        values[i] = ((Valve *)c)->values[which[i]];
    }
    return OK;
}
EXPORT int fmi2SetReal(void *c, const unsigned int which[], size_t n, const double values[]) {
    for (size_t i = 0; i < n; i++) {
        if (which[i] != CURRENT) return ERROR;
        ((Valve *)c)->values[CURRENT] = values[i];
    }
    return OK;
}
EXPORT int fmi2DoStep(void *c, double now, double duration, int no_return) {
    int steps = (int)ceil(duration / LONGEST_STEP_S);
    for (int i = 0; i < steps; i++) step(c, duration / steps);
    return OK;
}

/* What the standard asks for, and this model has not. */
#define NONE(name, ...) EXPORT int name(void *c, __VA_ARGS__) { return ERROR; }
NONE(fmi2GetInteger, const unsigned int w[], size_t n, int v[])
NONE(fmi2GetBoolean, const unsigned int w[], size_t n, int v[])
NONE(fmi2GetString, const unsigned int w[], size_t n, const char *v[])
NONE(fmi2SetInteger, const unsigned int w[], size_t n, const int v[])
NONE(fmi2SetBoolean, const unsigned int w[], size_t n, const int v[])
NONE(fmi2SetString, const unsigned int w[], size_t n, const char *const v[])
NONE(fmi2GetFMUstate, void **s)
NONE(fmi2SetFMUstate, void *s)
NONE(fmi2FreeFMUstate, void **s)
NONE(fmi2SerializedFMUstateSize, void *s, size_t *n)
NONE(fmi2SerializeFMUstate, void *s, char b[], size_t n)
NONE(fmi2DeSerializeFMUstate, const char b[], size_t n, void **s)
NONE(fmi2GetDirectionalDerivative, const unsigned int u[], size_t n, const unsigned int k[], size_t m, const double a[], double b[])
NONE(fmi2SetRealInputDerivatives, const unsigned int w[], size_t n, const int o[], const double v[])
NONE(fmi2GetRealOutputDerivatives, const unsigned int w[], size_t n, const int o[], double v[])
NONE(fmi2GetStatus, int k, int *v)
NONE(fmi2GetRealStatus, int k, double *v)
NONE(fmi2GetIntegerStatus, int k, int *v)
NONE(fmi2GetBooleanStatus, int k, int *v)
NONE(fmi2GetStringStatus, int k, const char **v)
EXPORT int fmi2CancelStep(void *c) { return ERROR; }
