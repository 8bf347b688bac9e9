/* What a kernel is given and what it keeps: the same for every model. */
struct problem {
    const real *const *series;      /* one array (rows, elements) a signal that is read */
    int64_t rows;
    const uint8_t *const *scored;   /* rows at which each loss counts; NULL for all */
    int64_t skip;
};

struct group {
    int64_t steps;
    int64_t start[GROUP];
    truth used[GROUP];              /* -1 where there is a sample; the others repeat one */
};

/* The samples of a group that stand in one vector. */
struct part {
    const int64_t *start;
    mask used;
};

static struct part part_of(const struct group *g, int number)
{
    struct part found = {g->start + number * LANES, no_lane};
    memcpy(&found.used, g->used + number * LANES, sizeof found.used);
    return found;
}

/* Samples start+first … of one lane; rows outside the log belong to samples that nothing reads. */
static void gather_lane(const struct problem *p, const real *series, int64_t start, int64_t count,
                        int64_t elements, real *out)
{
    for (int64_t i = 0; i < count * elements; i++) {
        const int64_t row = start + i / elements;
        out[i * LANES] = row < 0 || row >= p->rows ? 0 : series[start * elements + i];
    }
}

/* Samples start+first … of every lane, a row a time. */
static void gather(const struct problem *p, int signal, const struct part *g, int64_t first,
                   int64_t count, int64_t elements, lanes *rows)
{
    const real *const series = p->series[signal];
    const real *from[LANES];
    int inside = count * elements >= TILE;
    for (int l = 0; l < LANES; l++) {
        const int64_t start = g->start[l] + first;
        inside &= start >= 0 && start + count <= p->rows;
        from[l] = series + start * elements;
    }
    if (!inside) {
        for (int l = 0; l < LANES; l++) {
            gather_lane(p, series, g->start[l] + first, count, elements, (real *)rows + l);
        }
        return;
    }
    const int64_t last = count * elements - TILE;
    for (int64_t i = 0; i < last; i += TILE) {
        transpose(from, i, rows + i);
    }
    transpose(from, last, rows + last);
}

/* Lanes whose loss l counts at step t of the rollout, by the table of rows. */
inline_function mask scored_lanes(const struct problem *p, const struct part *g, int l, size_t t)
{
    mask found = no_lane;
    for (int i = 0; i < LANES; i++) {
        found[i] = p->scored[l][g->start[i] + (int64_t)t] ? g->used[i] : 0;
    }
    return found;
}
