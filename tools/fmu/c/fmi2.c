/* The functions of FMI 2 for co-simulation that differ from those of FMI 3. */
#include "fmi.c"

typedef struct {
    void *logger, *allocate, *release, *finished, *host;
} callbacks;

API const char *fmi2GetTypesPlatform(void) { return "default"; }
API void *fmi2Instantiate(const char *name, int kind, const char *token, const char *resources,
                          const callbacks *functions, int is_visible, int is_logging) {
    return kind == 1 ? make(name, token, functions ? functions->logger : NULL, functions ? functions->host : NULL) : NULL;
}
API int fmi2SetDebugLogging(instance *self, int is_on, size_t count, const char *const categories[]) {
    return wants(self, ANY, "fmi2SetDebugLogging");
}
API int fmi2SetupExperiment(instance *self, int has_tolerance, double tolerance, double start_s, int has_stop, double stop_s) {
    return wants(self, NEW, "fmi2SetupExperiment") ? ERROR : prepare(self, start_s);
}
API int fmi2EnterInitializationMode(instance *self) {
    return change_mode(self, NEW, STARTING, "fmi2EnterInitializationMode");
}

ACCESS(Real, double)
ACCESS(Integer, int32_t)

API int fmi2DoStep(instance *self, double t_s, double h_s, int forgets) {
    return wants(self, STEPPING, "fmi2DoStep") ? ERROR : advance_to(self, t_s, h_s);
}

/* FMI wants these symbols too; this FMU has no such variables and no derivatives, and a step ends when it returns. */
NOTHING(fmi2GetBoolean)
NOTHING(fmi2SetBoolean)
NOTHING(fmi2GetString)
NOTHING(fmi2SetString)
NOTHING(fmi2GetDirectionalDerivative)
NOTHING(fmi2SetRealInputDerivatives)
NOTHING(fmi2GetRealOutputDerivatives)
NOTHING(fmi2CancelStep)
NOTHING(fmi2GetStatus)
NOTHING(fmi2GetRealStatus)
NOTHING(fmi2GetIntegerStatus)
NOTHING(fmi2GetBooleanStatus)
NOTHING(fmi2GetStringStatus)
