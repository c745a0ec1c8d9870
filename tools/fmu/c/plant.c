/* The plant: what `plant_sim.plant.Plant` does with the same functions. */
#include "fmu.h"
#include "normal.h"

int64_t plant_parts(const double *v, uint64_t *parts);
int64_t plant_begin(const double *v, uint64_t *run);
int64_t plant_change(uint64_t *run, const uint64_t *after, double kick);
int64_t plant_step(uint64_t *run, double torque, double t_s, double h_s, double *out);
int64_t plant_advance(uint64_t *run);
int64_t plant_read(const double *v, uint64_t *run, const double *noise, double *out);

enum { TORQUE, KICKS }; /* places in `own` of the inputs that act */

static const char *message_of(int64_t status) {
    switch (status) {
    case 0: return NULL;
    case 2: return "no step is small enough; raise solver.accuracy, or make the parts less extreme";
    case 3: return "the motion is too costly to follow; raise solver.accuracy, or make the parts less extreme";
    default: return "the arithmetic of the model failed";
    }
}

/* The run; the address in it is written anew, since a restored state may come from another process. */
static uint64_t *run_of(block *b) {
    uint64_t *run = b->words + RUN, *memory = (uint64_t *)(uintptr_t)run[MEMORY_AT];
    memory[ADVANCE_AT] = (uint64_t)(uintptr_t)plant_advance;
    return run;
}

static const char *advance(block *b, double torque_n_m, double h_s) {
    return message_of(plant_step(run_of(b), torque_n_m, b->t_s + b->t_rest_s, h_s, b->v + OUT));
}

#ifdef NODE
#include "frames.h"

int64_t node_tick(const uint64_t *config, uint64_t *state, uint64_t *mail, uint64_t *run, double *out);

/* A tick: frames in, frames out; the drive commands the torque. */
static const char *move(block *b, double h_s) {
    uint64_t *w = b->words, *mail = w + MAIL;
    int64_t *counts = (int64_t *)mail[COUNTS_AT];
    (void)h_s;
    memcpy((double *)mail[READINGS_AT], b->v + READINGS, READINGS_BYTES);
    counts[0] = frames_from(b->v + RECEIVED, (struct frame *)mail[RECEIVED_AT]);
    const char *wrong = message_of(node_tick(w + CONFIG, w + STATE, mail, run_of(b), b->v + OUT));
    b->own[TORQUE] = *(const double *)mail[TORQUE_N_M_AT];
    frames_to(b->v + SENT, counts[1], (struct frame *)mail[SENT_AT]);
    return wrong;
}
#else
static const char *move(block *b, double h_s) {
    return b->own[TORQUE] = b->v[TORQUE_IN], advance(b, b->own[TORQUE], h_s);
}
#endif

static void read_sensors(block *b) {
#if READINGS
    double noise[4];
    for (int i = 0; i < 4; i++) noise[i] = normal(b->words + NOISE);
    plant_read(b->v, b->words + RUN, noise, b->v + READINGS);
#else
    (void)normal, (void)b;
#endif
}

static const char *parts(block *b, uint64_t *parts) {
    int64_t broken = plant_parts(b->v, parts);
    return broken == 0 ? NULL : broken < 0 ? "the arithmetic of the parameters failed" : RULES[broken];
}

const char *begin(block *b) {
    memcpy(b->words + NOISE, IMAGE + NOISE, 4 * sizeof *IMAGE);
#ifdef NODE
    memcpy(b->words + STATE, IMAGE + STATE, (MAIL - STATE) * sizeof *IMAGE);
#endif
    const char *wrong = parts(b, b->words + RUN); /* a run begins with its parts */
    if (wrong) return wrong;
    if (plant_begin(b->v, b->words + RUN))
        return "initial.x_m is beyond the rigid stop; start at stop.position_m at most";
    b->own[TORQUE] = 0.0, b->own[KICKS] = b->v[KICKS_IN], b->is_changed = 0;
    if ((wrong = advance(b, 0.0, 0.0))) return wrong;
    read_sensors(b);
    return NULL;
}

const char *step(block *b, double h_s, int *is_unchanged) {
    uint64_t *run = b->words + RUN, after[PARTS_WORDS];
    const char *wrong;
    if (b->is_changed) {
        memcpy(after, run, sizeof after);
        wrong = parts(b, after);
        if (!wrong && plant_change(run, after, 0.0))
            wrong = "the striker is beyond the rigid stop of these parameters; change them when it is clear of it";
        if (wrong) return *is_unchanged = 1, wrong;
        memcpy(run, after, sizeof after);
        b->is_changed = 0;
        if ((wrong = advance(b, b->own[TORQUE], 0.0))) return wrong;
    }
    double kick_m_s = b->v[KICKS_IN] - b->own[KICKS];
    if (kick_m_s != 0.0) {
        plant_change(run, run, kick_m_s);
        if ((wrong = advance(b, b->own[TORQUE], 0.0))) return wrong;
    }
    b->own[KICKS] = b->v[KICKS_IN];
    if ((wrong = move(b, h_s))) return wrong;
    read_sensors(b);
    return NULL;
}
