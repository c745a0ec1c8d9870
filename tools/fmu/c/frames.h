/* Frames between the variables of an FMU and a node; MOST_RECEIVED and the places are in `model.h`. */
struct frame { int64_t id, length; uint64_t word; };

static int64_t frames_from(const double *v, struct frame *frames) {
    int64_t count = (int64_t)*v;
    for (int64_t i = 0; i < count; i++) {
        const double *f = v + 1 + 4 * i;
        frames[i] = (struct frame){(int64_t)f[0], (int64_t)f[1], (uint32_t)(int32_t)f[2] | (uint64_t)(uint32_t)(int32_t)f[3] << 32};
    }
    return count;
}

static void frames_to(double *v, int64_t count, const struct frame *frames) {
    *v = (double)count;
    for (int64_t i = 0; i < count; i++) {
        double *f = v + 1 + 4 * i;
        f[0] = (double)frames[i].id, f[1] = (double)frames[i].length;
        f[2] = (int32_t)(uint32_t)frames[i].word, f[3] = (int32_t)(uint32_t)(frames[i].word >> 32);
    }
}
