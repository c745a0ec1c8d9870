/* The functions of FMI 3 for co-simulation that differ from those of FMI 2. */
#include <stdbool.h>

#include "fmi.c"

API void *fmi3InstantiateCoSimulation(const char *name, const char *token, const char *resources, bool is_visible,
                                      bool is_logging, bool has_events, bool may_return_early,
                                      const uint32_t required[], size_t count, void *host, void *logger, void *update) {
    return make(name, token, logger, host);
}
API void *fmi3InstantiateModelExchange(void) { return NULL; }
API void *fmi3InstantiateScheduledExecution(void) { return NULL; }
API int fmi3SetDebugLogging(instance *self, bool is_on, size_t count, const char *const categories[]) {
    return wants(self, ANY, "fmi3SetDebugLogging");
}
API int fmi3EnterInitializationMode(instance *self, bool has_tolerance, double tolerance, double start_s,
                                    bool has_stop, double stop_s) {
    return prepare(self, start_s) || change_mode(self, NEW, STARTING, "fmi3EnterInitializationMode") ? ERROR : OK;
}

ACCESS(Float64, double)
ACCESS(Int32, int32_t)

API int fmi3DoStep(instance *self, double t_s, double h_s, bool forgets, bool *has_event, bool *ends, bool *is_early,
                   double *reached_s) {
    *has_event = *ends = *is_early = false;
    int status = wants(self, STEPPING, "fmi3DoStep") ? ERROR : advance_to(self, t_s, h_s);
    if (self) *reached_s = self->b.t_s + self->b.t_rest_s;
    return status;
}

/* FMI wants these symbols too; this FMU has no such variables, no derivatives, and no modes of events. */
#define NEITHER(kind) NOTHING(fmi3Get##kind) NOTHING(fmi3Set##kind)
NEITHER(Float32) NEITHER(Int8) NEITHER(UInt8) NEITHER(Int16) NEITHER(UInt16) NEITHER(UInt32) NEITHER(Int64)
NEITHER(UInt64) NEITHER(Boolean) NEITHER(String) NEITHER(Binary) NEITHER(Clock) NEITHER(IntervalDecimal)
NEITHER(IntervalFraction) NEITHER(ShiftDecimal) NEITHER(ShiftFraction) NEITHER(ContinuousStates)
NOTHING(fmi3EnterEventMode) NOTHING(fmi3EnterStepMode) NOTHING(fmi3EnterConfigurationMode)
NOTHING(fmi3ExitConfigurationMode) NOTHING(fmi3EnterContinuousTimeMode) NOTHING(fmi3CompletedIntegratorStep)
NOTHING(fmi3EvaluateDiscreteStates) NOTHING(fmi3UpdateDiscreteStates) NOTHING(fmi3SetTime)
NOTHING(fmi3GetNumberOfVariableDependencies) NOTHING(fmi3GetVariableDependencies) NOTHING(fmi3GetDirectionalDerivative)
NOTHING(fmi3GetAdjointDerivative) NOTHING(fmi3GetOutputDerivatives) NOTHING(fmi3GetContinuousStateDerivatives)
NOTHING(fmi3GetEventIndicators) NOTHING(fmi3GetNominalsOfContinuousStates) NOTHING(fmi3GetNumberOfEventIndicators)
NOTHING(fmi3GetNumberOfContinuousStates) NOTHING(fmi3ActivateModelPartition)
