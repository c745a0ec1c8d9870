/* The firmware: each step of one period is one call of its tick. */
#include "fmu.h"
#include "frames.h"

void vibro_receive(void *state, int64_t count, const struct frame *frames);
void vibro_tick(const void *config, void *state, void *tx);

const char *begin(block *b) {
    (void)b;
    return NULL;
}

const char *step(block *b, double h_s, int *is_unchanged) {
    struct frame frames[MOST_RECEIVED];
    struct { int64_t count; struct frame frames[MOST_SENT]; } *sent = (void *)(b->words + TX);
    (void)h_s, *is_unchanged = 1;
    vibro_receive(b->words + STATE, frames_from(b->v + RECEIVED, frames), frames);
    vibro_tick(b->words + CONFIG, b->words + STATE, sent);
    frames_to(b->v + SENT, sent->count, sent->frames);
    return NULL;
}
