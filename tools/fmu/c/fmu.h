/* An instance of an FMU: one block of words without allocation; `model.h` is generated. */
#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

struct variable {
    const char *name;
    char role; /* i(nput), o(utput), f(ixed), t(unable) */
    double start, low, high;
};

#include "model.h"

typedef struct {
    uint64_t token; /* which FMU the block belongs to */
    int64_t mode, is_changed;
    double t_s, t_rest_s;
    double v[VARIABLES];
    double own[4]; /* the model's */
    uint64_t words[WORDS]; /* records, then arrays; the words in POINTERS are offsets in a snapshot */
} block;

/* Begin at the values in v, and make a step; each returns NULL or a message. `is_unchanged`: the step may be tried again. */
const char *begin(block *b);
const char *step(block *b, double h_s, int *is_unchanged);
