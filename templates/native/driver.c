/* What a kernel is given and what it keeps: the same for every model. */
struct problem {
    const real *const *series;      /* one array (rows, elements) a signal that is read */
    int64_t rows;
    const uint8_t *const *scored;   /* rows at which each loss counts; NULL for all */
    int64_t skip;
};

struct group {
    int64_t steps;
    int64_t start[LANES];
    truth used[LANES];              /* -1 in lanes with a sample of their own; others repeat one */
};

/* Samples start+first … of every lane, a row a time. */
static void gather(const struct problem *p, int signal, const struct group *g, int64_t first,
                   int64_t count, int64_t elements, lanes *rows)
{
    const real *const series = p->series[signal];
    real *const out = (real *)rows;
    for (int l = 0; l < LANES; l++) {
        const int64_t start = g->start[l] + first;
        const real *const from = series + start * elements;
        /* rows outside the log belong to samples that nothing reads */
        const int64_t low = start < 0 ? -start : 0;
        const int64_t high = start + count > p->rows ? p->rows - start : count;
        for (int64_t i = 0; i < low * elements; i++) {
            out[i * LANES + l] = 0;
        }
        for (int64_t i = low * elements; i < high * elements; i++) {
            out[i * LANES + l] = from[i];
        }
        for (int64_t i = high * elements; i < count * elements; i++) {
            out[i * LANES + l] = 0;
        }
    }
}

/* Lanes whose loss l counts at step t of the rollout. */
inline_function mask scored_lanes(const struct problem *p, const struct group *g, int l, int64_t t)
{
    if (t < p->skip) {
        return no_lane;
    }
    if (p->scored == NULL || p->scored[l] == NULL) {
        mask used;
        memcpy(&used, g->used, sizeof used);
        return used;
    }
    mask found = no_lane;
    for (int i = 0; i < LANES; i++) {
        found[i] = p->scored[l][g->start[i] + t] ? g->used[i] : 0;
    }
    return found;
}
