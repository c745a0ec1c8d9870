/* Runs recorded ticks: config, state and ticks come from standard input, frames and the last state go to standard
 * output. A tick is the number of its frames and the frames. */
#include <stdio.h>
#include <stdlib.h>

#include "vibro_firmware.h"

enum { MOST_FRAMES = 4096 };

static void take(void *place, size_t size) {
    if (fread(place, 1, size, stdin) != size) {
        exit(2);
    }
}

static void give(const void *place, size_t size) {
    if (fwrite(place, 1, size, stdout) != size) {
        exit(3);
    }
}

int main(void) {
    static vibro_config config;
    static vibro_firmware_state state;
    static vibro_word_frame frames[MOST_FRAMES];
    static vibro_tx tx;
    int64_t ticks = 0;
    take(&config, sizeof config);
    take(&state, sizeof state);
    take(&ticks, sizeof ticks);
    for (int64_t tick = 0; tick < ticks; tick++) {
        int64_t count = 0;
        take(&count, sizeof count);
        if (count < 0 || count > MOST_FRAMES) {
            return 4;
        }
        take(frames, (size_t)count * sizeof frames[0]);
        vibro_receive(&state, count, frames);
        for (int32_t periods = vibro_advance(&config, &state, 1); periods > 0; periods--) {
            vibro_calibrate(&config, &state);
            vibro_tick(&config, &state, &tx);
            give(&tx, sizeof tx.frame_count + (size_t)tx.frame_count * sizeof frames[0]);
        }
    }
    give(&state, sizeof state);
    return 0;
}
