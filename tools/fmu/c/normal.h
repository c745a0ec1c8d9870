/* numpy's standard normals: PCG64 (O'Neill 2014, XSL-RR) and the ziggurat (Marsaglia & Tsang 2000) with the tables
 * K, W, F in `model.h`. `state` is PCG64's state and increment, low words first. */
static uint64_t uniform(uint64_t state[4]) {
    const unsigned __int128 factor = (unsigned __int128)0x2360ED051FC65DA4 << 64 | 0x4385DF649FCCF645;
    unsigned __int128 s = (unsigned __int128)state[1] << 64 | state[0], inc = (unsigned __int128)state[3] << 64 | state[2];
    s = s * factor + inc;
    state[0] = (uint64_t)s, state[1] = (uint64_t)(s >> 64);
    uint64_t mixed = state[0] ^ state[1];
    unsigned turn = (unsigned)(state[1] >> 58);
    return mixed >> turn | mixed << (-turn & 63);
}

static double share(uint64_t state[4]) { return (double)(uniform(state) >> 11) * 0x1p-53; }

static double normal(uint64_t state[4]) {
    const double tail = 3.6541528853610088, inverse = 0.27366123732975828;
    for (;;) {
        uint64_t bits = uniform(state), layer = bits & 0xff, place = bits >> 9 & 0x000fffffffffffff;
        double x = (double)place * W[layer];
        if (bits >> 8 & 1) x = -x;
        if (place < K[layer]) return x;
        if (layer > 0) {
            if ((F[layer - 1] - F[layer]) * share(state) + F[layer] < exp(-0.5 * x * x)) return x;
            continue;
        }
        for (;;) {
            double far = -inverse * log1p(-share(state)), near = -log1p(-share(state));
            if (near + near > far * far) return place >> 8 & 1 ? -(tail + far) : tail + far;
        }
    }
}
