#include <string.h>

#include "vibro_config.h"

/* The board's own CAN driver. */
void can_send(uint32_t can_id, uint32_t length, const void *data);

static vibro_config config;
static vibro_firmware_state state;
static vibro_word_frame received[VIBRO_MAX_FRAMES];
static int64_t received_count;

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
    int64_t place = 0;
    if (received_count < VIBRO_MAX_FRAMES) {
        place = received_count++;
    } else { /* full: the oldest goes */
        memmove(&received[0], &received[1], sizeof received - sizeof received[0]);
        place = VIBRO_MAX_FRAMES - 1;
    }
    received[place].can_id = can_id;
    received[place].length = length;
    received[place].word = 0;
    memcpy(&received[place].word, data, length);
}

/* From a timer's interrupt at 1 kHz, with behind_ticks 0. After n missed interrupts call it with n, n - 1, ... 1
 * before: the torque (0x00E) of those is not sent. */
void control_tick(int64_t behind_ticks) {
    vibro_tx tx;
    const int32_t status =
        vibro_tick(&config, &state, behind_ticks, received_count, received, &tx);
    received_count = 0;
    if (status != 0) { /* a division by zero: nothing has moved on; the drive's E-stop */
        can_send(0x002, 0, "");
        return;
    }
    if (tx.frame_count > 0 && (behind_ticks == 0 || tx.first.can_id != 0x00E)) {
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
