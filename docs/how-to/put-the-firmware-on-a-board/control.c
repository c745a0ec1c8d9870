#include <string.h>

#include "vibro_config.h"

/* The board's own CAN driver. */
void can_send(uint32_t can_id, uint32_t length, const void *data);

static vibro_config config;
static vibro_firmware_state state;

static void send(const vibro_word_frame *frame) {
    can_send((uint32_t)frame->can_id, (uint32_t)frame->length, &frame->word);
}

/* Before the interrupts are on. */
void control_power_up(void) {
    config = VIBRO_CONFIG;
    vibro_power_up(&state);
}

/* From the CAN controller's receive interrupt, for each data frame with an 11-bit identifier. */
void control_receive(uint32_t can_id, uint32_t length, const void *data) {
    vibro_word_frame frame = {can_id, length, 0};
    memcpy(&frame.word, data, length);
    vibro_receive(&state, 1, &frame);
}

/* From a timer's interrupt at 1 kHz, with elapsed_ticks 1; after n missed interrupts with n + 1. */
void control_tick(int64_t elapsed_ticks) {
    for (int32_t left = vibro_advance(&config, &state, elapsed_ticks); left > 0; left--) {
        vibro_tx tx;
        vibro_tick(&config, &state, &tx);
        if (tx.frame_count > 0) {
            send(&tx.first);
        }
        if (tx.frame_count > 1) {
            send(&tx.second);
        }
        if (tx.frame_count > 2) {
            send(&tx.third);
        }
        vibro_calibrate(&config, &state); /* optional: changes of parameters over XCP */
    }
}
