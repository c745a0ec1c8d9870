/* Modes of an instance, checks of values and steps, snapshots. */
#include "fmu.h"

#define API __attribute__((visibility("default")))
enum { OK, WARNING, DISCARD, ERROR };
enum { NEW = 1, STARTING = 2, STEPPING = 4, ENDED = 8, FAILED = 16, ANY = 31 };

#if FMI == 3
#define NAMED(name) fmi3##name
#define STATE(verb, noun) fmi3##verb##FMUState##noun
#define DESERIALIZE fmi3DeserializeFMUState
#define SIZE , size_t size /* of the array of values */
#define IS_SHORT (size < count)
#define LOG(self, status, message) ((void (*)(void *, int, const char *, const char *))(self)->logger) \
    ((self)->host, status, "logStatusError", message)
#else
#define NAMED(name) fmi2##name
#define STATE(verb, noun) fmi2##verb##FMUstate##noun
#define DESERIALIZE fmi2DeSerializeFMUstate
#define SIZE
#define IS_SHORT 0
#define LOG(self, status, message) ((void (*)(void *, const char *, int, const char *, const char *, ...))(self)->logger) \
    ((self)->host, (self)->name, status, "logStatusError", message)
#endif

typedef struct {
    char *name;
    void *host;
    void *logger;
    block b;
} instance;

static int report(instance *self, int status, const char *format, const char *name, double a, double b) {
    char message[400];
    snprintf(message, sizeof message, format, name, a, b);
    if (!self->logger) return status;
    LOG(self, status, message);
    return status;
}

static int refuse(instance *self, int status, const char *message) {
    return report(self, status, "%s", message, 0.0, 0.0);
}

/* A function that FMI wants and that this FMU does not have; the caller's other arguments are not read. */
#define NOTHING(function) \
    API int function(instance *self) { return refuse(self, ERROR, #function " is not supported"); }

static int wants(instance *self, int modes, const char *function) {
    if (self && self->b.mode & modes) return OK;
    return self ? report(self, ERROR, "%s is not allowed in this mode of the instance", function, 0.0, 0.0) : ERROR;
}

/* Turn the pointers of a block into offsets (direction −1) or back (1). */
static void shift(block *b, const block *home, int direction) {
    for (int i = 0; i < POINTER_COUNT; i++)
        b->words[POINTERS[i]] += (uint64_t)direction * (uint64_t)(uintptr_t)home->words;
}

static void renew(instance *self) {
    block *b = &self->b;
    memset(b, 0, sizeof *b);
    b->token = TOKEN_WORD, b->mode = NEW;
    for (int i = 0; i < VARIABLES; i++) b->v[i] = TABLE[i].start;
    memcpy(b->words, IMAGE, sizeof IMAGE);
    shift(b, b, 1);
}

static instance *make(const char *name, const char *token, void *logger, void *host) {
    instance *self = calloc(1, sizeof *self);
    if (!self) return NULL;
    self->logger = logger, self->host = host, self->name = strdup(name ? name : "");
    if (!token || strcmp(token, TOKEN)) {
        refuse(self, ERROR, "the token of modelDescription.xml is not that of this binary");
        free(self->name), free(self);
        return NULL;
    }
    renew(self);
    return self;
}

static int get(instance *self, const uint32_t *which, size_t i, double *value) {
    if (FMI == 3 && which[i] == VARIABLES) { /* `time` follows the variables */
        *value = self->b.t_s + self->b.t_rest_s;
        return OK;
    }
    if (which[i] >= VARIABLES) return report(self, ERROR, "%svalue reference %.0f: no such variable", "", which[i], 0.0);
    const char *wrong = self->b.mode == STARTING && TABLE[which[i]].role == 'o' ? begin(&self->b) : NULL;
    *value = self->b.v[which[i]];
    return wrong ? refuse(self, ERROR, wrong) : OK;
}

static int set(instance *self, const uint32_t *which, size_t i, double value) {
    if (which[i] >= VARIABLES) return report(self, ERROR, "%svalue reference %.0f: no such variable", "", which[i], 0.0);
    const struct variable *it = TABLE + which[i];
    if (it->role == 'o') return report(self, ERROR, "%s is an output and cannot be set", it->name, 0.0, 0.0);
    if (it->role == 'f' && !(self->b.mode & (NEW | STARTING)))
        return report(self, ERROR, "%s is fixed; set it before the end of the initialization", it->name, 0.0, 0.0);
    if (!isfinite(value)) return report(self, ERROR, "%s = %g: wanted a finite number", it->name, value, 0.0);
    if (value < it->low) return report(self, ERROR, "%s = %g is below its minimum %g", it->name, value, it->low);
    if (value > it->high) return report(self, ERROR, "%s = %g is above its maximum %g", it->name, value, it->high);
    self->b.is_changed |= self->b.v[which[i]] != value && ACTS_ON_PARTS(which[i]);
    self->b.v[which[i]] = value;
    return OK;
}

#define ACCESS(kind, type)                                                                                     \
    API int NAMED(Get##kind)(instance *self, const uint32_t which[], size_t count, type values[] SIZE) {       \
        double value = 0.0;                                                                                    \
        if (wants(self, ANY, __func__) || IS_SHORT) return ERROR;                                              \
        for (size_t i = 0; i < count; i++) {                                                                   \
            if (get(self, which, i, &value)) return ERROR;                                                     \
            values[i] = (type)value;                                                                           \
        }                                                                                                      \
        return OK;                                                                                             \
    }                                                                                                          \
    API int NAMED(Set##kind)(instance *self, const uint32_t which[], size_t count, const type values[] SIZE) { \
        if (wants(self, NEW | STARTING | STEPPING, __func__) || IS_SHORT) return ERROR;                        \
        for (size_t i = 0; i < count; i++)                                                                     \
            if (set(self, which, i, values[i])) return ERROR;                                                  \
        return OK;                                                                                             \
    }

API const char *NAMED(GetVersion)(void) { return FMI == 3 ? "3.0" : "2.0"; }
API void NAMED(FreeInstance)(instance *self) {
    if (self) free(self->name), free(self);
}

static int change_mode(instance *self, int from, int to, const char *function) {
    if (wants(self, from, function)) return ERROR;
    self->b.mode = to;
    return OK;
}

API int NAMED(Terminate)(instance *self) { return change_mode(self, STEPPING, ENDED, __func__); }
API int NAMED(Reset)(instance *self) {
    if (wants(self, ANY, __func__)) return ERROR;
    renew(self);
    return OK;
}

static int prepare(instance *self, double start_s) {
    return start_s == 0.0 ? OK : report(self, ERROR, "%sthe start time is %g s; wanted 0", "", start_s, 0.0);
}

API int NAMED(ExitInitializationMode)(instance *self) {
    if (wants(self, STARTING, __func__)) return ERROR;
    const char *wrong = begin(&self->b);
    if (wrong) return refuse(self, ERROR, wrong);
    self->b.mode = STEPPING;
    return OK;
}

static int advance_to(instance *self, double t_s, double h_s) {
    block *b = &self->b;
    double now_s = b->t_s + b->t_rest_s;
    if (!isfinite(h_s) || h_s <= 0.0) return report(self, ERROR, "%sthe step is %g s; wanted a positive one", "", h_s, 0.0);
    if (!(fabs(t_s - now_s) <= 1e-9 * fmax(1.0, fabs(now_s))))
        return report(self, ERROR, "%sthe step begins at %.12g s; the instance is at %.12g s", "", t_s, now_s);
#ifdef PERIOD_S
    if (fabs(h_s - PERIOD_S) > 1e-9) return report(self, DISCARD, "%sthe step is %g s; wanted the period of %g s", "", h_s, PERIOD_S);
#endif
    int is_unchanged = 0;
    const char *wrong = step(b, h_s, &is_unchanged);
    if (wrong && is_unchanged) return refuse(self, DISCARD, wrong);
    if (wrong) {
        b->mode = FAILED;
        return refuse(self, ERROR, wrong);
    }
    double sum_s = b->t_s + h_s; /* Neumaier's sum: a day of steps adds up to a day */
    b->t_rest_s += b->t_s - sum_s + h_s, b->t_s = sum_s;
    return OK;
}

/* States of an instance: its block with offsets in place of pointers. */
API int STATE(Get, )(instance *self, block **state) {
    if (wants(self, ANY, __func__)) return ERROR;
    free(*state);
    if (!(*state = malloc(sizeof **state))) return refuse(self, ERROR, "no memory for a state");
    **state = self->b, shift(*state, &self->b, -1);
    return OK;
}

API int STATE(Set, )(instance *self, const block *state) {
    if (wants(self, ANY, __func__)) return ERROR;
    if (!state || state->token != TOKEN_WORD) return refuse(self, ERROR, "the state is not one of this FMU");
    self->b = *state;
    shift(&self->b, &self->b, 1);
    return OK;
}

API int STATE(Free, )(instance *self, block **state) {
    free(*state), *state = NULL;
    return OK;
}

API int STATE(Serialized, Size)(instance *self, const block *state, size_t *size) {
    *size = sizeof *state;
    return wants(self, ANY, __func__);
}

API int STATE(Serialize, )(instance *self, const block *state, char bytes[], size_t size) {
    if (!state || size < sizeof *state) return refuse(self, ERROR, "the state does not fit into these bytes");
    memcpy(bytes, state, sizeof *state);
    return OK;
}

API int DESERIALIZE(instance *self, const char bytes[], size_t size, block **state) {
    if (size != sizeof **state) return refuse(self, ERROR, "the bytes are not a state of this FMU");
    if (!(*state = malloc(size))) return refuse(self, ERROR, "no memory for a state");
    memcpy(*state, bytes, size);
    return OK;
}
