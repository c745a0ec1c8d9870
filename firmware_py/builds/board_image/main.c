/* The firmware on an emulated board: frames in and out through QEMU's standard input and output.
 *
 * A request consists of its kind and a number. RECEIVE is followed by that number of frames; CONFIG and STATE
 * are followed by a new config or state, which replaces the present one. The reply to ADVANCE, of that number of
 * periods, is the number of ticks to run. The reply to TICK is the frames to be sent and the state;
 * MEASURED_TICK, which is slower, also reports the time and the stack of the tick. The reply to READ_CONFIG is
 * the config. Before each tick a write over XCP is processed.
 * The bytes are carried by semihosting, a debugger's interface that the firmware itself does not use.
 */
#include <string.h>

#include "vibro_firmware.h"

enum { TICK, CONFIG, STATE, MEASURED_TICK, READ_CONFIG, RECEIVE, ADVANCE };
enum { SYS_OPEN = 0x01, SYS_WRITE = 0x05, SYS_READ = 0x06, SYS_EXIT_EXTENDED = 0x20 };
enum { READ_BINARY = 1, WRITE_BINARY = 5, ENDED = 0x20026 };

static struct {
    int64_t kind, number;
} request;
static struct {
    int64_t timer_ticks, stack_bytes;
    vibro_tx tx;
    vibro_firmware_state state;
} reply;
static vibro_config config;
static int input, output;

static int semihosting(int operation, const void *arguments) {
    register int r0 __asm__("r0") = operation;
    register const void *r1 __asm__("r1") = arguments;
    __asm__ volatile("bkpt 0xAB" : "+r"(r0) : "r"(r1) : "memory", "cc");
    return r0;
}

static void end(uint32_t status) {
    const uint32_t arguments[2] = {ENDED, status};
    semihosting(SYS_EXIT_EXTENDED, arguments);
    for (;;) {
    }
}

static int open_file(const char *name, uint32_t mode) {
    const uint32_t arguments[3] = {(uint32_t)name, mode, strlen(name)};
    return semihosting(SYS_OPEN, arguments);
}

/* Read `size` bytes; at the end of the input, end the emulator. */
static void take(void *memory, uint32_t size) {
    while (size > 0) {
        const uint32_t arguments[3] = {(uint32_t)input, (uint32_t)memory, size};
        const uint32_t left = (uint32_t)semihosting(SYS_READ, arguments);
        if (left >= size) {
            end(0);
        }
        memory = (uint8_t *)memory + (size - left);
        size = left;
    }
}

static void give(const void *memory, uint32_t size) {
    const uint32_t arguments[3] = {(uint32_t)output, (uint32_t)memory, size};
    if (semihosting(SYS_WRITE, arguments) != 0) {
        end(1);
    }
}

/* The board's timer counts down. The stack below this function is painted and searched from its far end. */
#define TIMER ((volatile uint32_t *)0x40000000)
enum { CONTROL, VALUE, RELOAD, PAINT = 0x50A17ED, PAINTED_WORDS = 4096 };

static void tick(void) {
    vibro_calibrate(&config, &reply.state);
    vibro_tick(&config, &reply.state, &reply.tx);
}

static __attribute__((noinline)) void measured_tick(void) {
    uint32_t *top;
    __asm__ volatile("mov %0, sp" : "=r"(top));
    uint32_t *const end_of_paint = top - PAINTED_WORDS;
    for (volatile uint32_t *word = end_of_paint; word < top; word++) {
        *word = PAINT;
    }
    TIMER[CONTROL] = 1;
    const uint32_t before = TIMER[VALUE];
    tick();
    reply.timer_ticks = before - TIMER[VALUE];
    const volatile uint32_t *deepest = end_of_paint;
    while (*deepest == PAINT) {
        deepest++;
    }
    reply.stack_bytes = (int64_t)((uintptr_t)top - (uintptr_t)deepest);
}

static void receive(int64_t count) {
    for (; count > 0; count--) {
        vibro_word_frame frame;
        take(&frame, sizeof frame);
        vibro_receive(&reply.state, 1, &frame);
    }
}

static void advance(int64_t elapsed_ticks) {
    const int64_t periods = vibro_advance(&config, &reply.state, elapsed_ticks);
    give(&periods, sizeof periods);
}

static void serve(void) {
    input = open_file("/dev/stdin", READ_BINARY);
    output = open_file("/dev/stdout", WRITE_BINARY);
    TIMER[RELOAD] = TIMER[VALUE] = 0xFFFFFFFF;
    vibro_power_up(&reply.state);
    for (;;) {
        take(&request, sizeof request);
        if (request.kind == CONFIG) {
            take(&config, sizeof config);
        } else if (request.kind == STATE) {
            take(&reply.state, sizeof reply.state);
        } else if (request.kind == READ_CONFIG) {
            give(&config, sizeof config);
        } else if (request.kind == RECEIVE) {
            receive(request.number);
        } else if (request.kind == ADVANCE) {
            advance(request.number);
        } else {
            if (request.kind == MEASURED_TICK) {
                measured_tick();
            } else {
                tick();
            }
            give(&reply, sizeof reply);
        }
    }
}

extern uint32_t _bss, _ebss, _stack;

void reset(void) {
    *(volatile uint32_t *)0xE000ED88 |= 0xFu << 20; /* CPACR: enable the floating-point unit */
    __asm__ volatile("dsb\n isb");
    for (uint32_t *word = &_bss; word < &_ebss; word++) {
        *word = 0;
    }
    serve();
}

static void fault(void) { end(2); }

__attribute__((section(".vectors"), used)) static const void *const vectors[16] = {
    &_stack, reset, fault, fault, fault, fault, fault,
};
